//! The `sympose` command line; see `sympose --help`.

fn main() -> std::process::ExitCode {
    sympose::cli::main()
}
