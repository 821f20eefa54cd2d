//! The `sympose` command line; see `sympose --help`.

/// See the one of the extension module, which has its own.
#[cfg(not(feature = "python"))]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    sympose::cli::main()
}
