//! The program: everything is in the library, see [`palpate::cli`]. Only this file knows the commit that it is built from.

fn main() -> std::process::ExitCode {
    palpate::cli::main(palpate_commit::commit!())
}
