//! The `druse` program: parse, run, exit code.

fn main() -> std::process::ExitCode {
    druse::cli::main(std::env::args_os())
}
