//! The program: everything is in the library, see [`palpate::cli`].

fn main() -> std::process::ExitCode {
    palpate::cli::main()
}
