//! Recipes, rigs and batches that come with the program.

use std::path::Path;

/// A file that comes with the program.
pub(crate) struct Shipped {
    /// Its name without the folder and the ending.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! shipped {
    ($folder:literal: $($name:literal),+) => {
        [$(Shipped { name: $name, text: include_str!(concat!("../../", $folder, "/", $name, ".toml")) }),+]
    };
}

/// The recipes: `recipes/NAME.toml`.
pub(crate) const RECIPES: &[Shipped] =
    &shipped!("recipes": "paper", "calibrate", "characterise", "test", "bench", "batch", "over-time");

/// The rigs: `rigs/NAME.toml`.
pub(crate) const RIGS: &[Shipped] = &shipped!(
    "rigs": "sim", "paper", "bench-esp301", "bench-fast", "esp301", "xps", "grbl", "marlin", "klipper", "ur", "matrix", "process", "printer", "batch"
);

/// The batches: `batches/NAME.toml`.
pub(crate) const BATCHES: &[Shipped] = &shipped!("batches": "batch");

/// The shipped file that a path names, where nothing is at the path: `paper`, `paper.toml` or `recipes/paper.toml`.
pub(crate) fn named<'s>(shipped: &'s [Shipped], folder: &str, path: &Path) -> Option<&'s Shipped> {
    if path.symlink_metadata().is_ok() { None } else { by_name(shipped, folder, path) }
}

/// The shipped file that a path names.
pub(crate) fn by_name<'s>(shipped: &'s [Shipped], folder: &str, path: &Path) -> Option<&'s Shipped> {
    let path = path.to_str()?;
    let name = path.strip_prefix(&format!("{folder}/")).unwrap_or(path);
    let name = name.strip_suffix(".toml").unwrap_or(name);
    shipped.iter().find(|shipped| shipped.name == name)
}

/// The names of all.
pub(crate) fn names(shipped: &[Shipped]) -> Vec<&'static str> {
    shipped.iter().map(|shipped| shipped.name).collect()
}

/// The shipped file of which a path is a misspelling.
pub(crate) fn nearest(shipped: &[Shipped], path: &Path) -> Option<&'static str> {
    let name = path.to_str()?.trim_end_matches(".toml");
    palpate_document::misspelt(name, &names(shipped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_of_a_missing_file_means_the_shipped_file() {
        let found = |path: &str| named(RECIPES, "recipes", Path::new(path)).map(|shipped| shipped.name);
        for path in ["no-folder/paper", "recipes/none.toml", "papers", "rigs/paper.toml", "", "../recipes/paper.toml"] {
            assert_eq!(found(path), None, "{path}");
        }
        assert_eq!(found("paper"), Some("paper"));
        assert_eq!(found("paper.toml"), Some("paper"));
        // tests run in the project's folder, where this one is a file
        assert_eq!(found("recipes/paper.toml"), None);
    }
}
