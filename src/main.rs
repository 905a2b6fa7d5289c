//! The `druse` program: parse, run, exit code.

fn main() {
    druse::cli::main(std::env::args_os())
}
