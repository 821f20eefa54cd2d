# Works from an empty clone with Rust >= 1.89, Python >= 3.11 and make; everything else is fetched into .venv and target.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help demo test test-rust test-python lint lint-rust lint-python format setup bench evaluate wheel clean \
        prerequisites release debug

PYTHON ?= $(firstword $(foreach python,python3 python3.14 python3.13 python3.12 python3.11,$(shell \
    $(python) -c 'import sys; sys.version_info >= (3, 11) and print("$(python)")' 2>/dev/null)))
BIN := .venv/bin
MATURIN := VIRTUAL_ENV="$(CURDIR)/.venv" $(BIN)/maturin develop --locked --quiet
# What the named extras need, without the package itself, which is built later, for speed or for tests.
REQUIREMENTS := import sys, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
    needed = sum((project["optional-dependencies"][extra] for extra in sys.argv[1:]), project["dependencies"]); \
    print(*(line for line in needed if not line.startswith("sympose[")), sep="\n")
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
export PATH := $(PATH):$(HOME)/.cargo/bin
# Clippy builds pyo3 just as maturin does, so that neither makes the other build it again.
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python
export PYO3_BUILD_EXTENSION_MODULE := 1

help:
	@echo 'make demo      scan a synthetic part, find its pose, draw every stage, print the error'
	@echo 'make test      every check: formatting, lints, types, documentation, tests of both languages'
	@echo 'make setup     the package, built for speed, in .venv: source .venv/bin/activate'
	@echo 'make bench     time the stages, and other libraries beside them'
	@echo 'make evaluate  measure the errors on scans whose truth is known, into docs/evaluation.md'
	@echo 'make lint      only formatting, lints, types and documentation'
	@echo 'make format    format the sources'
	@echo 'make wheel     a wheel in dist'
	@echo 'make clean     remove what was built'

demo: release
	$(BIN)/python -m sympose demo

test: lint test-rust test-python

# The test build: optimised, with checks for overflow.
test-rust: prerequisites
	cargo test --locked --features cli

# A process for each core, up to four, as each test has threads of its own; what measures time comes after them, by itself.
test-python: debug
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 -m 'not timed' --doctest-modules python tests/python
	$(BIN)/python -m pytest -m timed tests/python

lint: lint-rust lint-python

lint-rust: prerequisites
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo clippy --locked --all-targets --features io -- -D warnings
	cargo clippy --locked --all-targets --features cli -- -D warnings
	cargo clippy --locked --lib --features python -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --locked --no-deps --features cli
	@if cargo tree --locked --edges normal --prefix none | grep -E '^(pyo3|clap)[^ ]* '; then \
	    echo 'without features the crate must bring neither pyo3 nor clap' >&2; exit 1; fi

lint-python: debug
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest sympose._core --mypy-config-file pyproject.toml

format: .venv/ready
	cargo fmt
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

setup: release
	@echo 'ready: source .venv/bin/activate'

bench: release .venv/peers
	cargo bench --locked
	$(BIN)/python benches/compare_peers.py

# From the beginning, so that all figures are of this build; about ten minutes on two cores.
evaluate: release .venv/peers
	rm -rf out/short
	$(BIN)/sympose evaluate --suite short --jobs 0 --out out/short --page docs/evaluation.md

release: prerequisites .venv/ready
	$(MATURIN) --release

debug: prerequisites .venv/ready
	$(MATURIN)

wheel: prerequisites .venv/ready
	$(BIN)/maturin build --locked --release --out dist

.venv/ready: pyproject.toml | prerequisites
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -c '$(REQUIREMENTS)' segment io plot datasets dev > .venv/requirements.txt
	$(PIP) --requirement .venv/requirements.txt
	touch $@

# Other libraries that are measured beside this one; large.
.venv/peers: .venv/ready
	$(BIN)/python -c '$(REQUIREMENTS)' evaluation > .venv/peers.txt
	$(PIP) --requirement .venv/peers.txt
	touch $@

clean:
	rm -rf .venv target dist out python/sympose/*.so

prerequisites:
	@fail() { printf '%s\n' "$$@" >&2; exit 1; }; \
	command -v cargo > /dev/null || fail 'Rust is missing (1.89 or later is needed). Get it with' \
	    "    curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh"; \
	version=$$(cd / && rustc --version | cut -d' ' -f2); \
	printf '%s\n' 1.89.0 "$${version%%-*}" | sort --check --version-sort 2> /dev/null || \
	    fail "Rust $$version is too old, 1.89 or later is needed: rustup update stable"; \
	test -n '$(PYTHON)' || fail 'Python 3.11 or later is missing. Get it from your package manager or' \
	    '    https://www.python.org/downloads' 'and name it where it is not found: make PYTHON=/path/to/python3'; \
	test -x $(BIN)/python || '$(PYTHON)' -c 'import ensurepip, venv' 2> /dev/null || \
	    fail '$(PYTHON) has no venv module; on Debian and Ubuntu: sudo apt install python3-venv'; \
	command -v cc > /dev/null || fail 'A linker is missing; on Debian and Ubuntu: sudo apt install build-essential'
