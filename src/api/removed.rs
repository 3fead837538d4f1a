//! Recipes of runs that name a method which was removed.

use super::Note;
use palpate_solver::{BEST, REMOVED};
use toml_edit::{DocumentMut, Item, value};

/// Returns a run's recipe with the remaining methods, and notes which one is missing. Where none remains, it is the best one.
pub(crate) fn with_remaining_methods(name: &str, text: &str, note: Note<'_>) -> String {
    // an invalid text is reported by its reader
    let Ok(mut recipe) = text.parse::<DocumentMut>() else { return text.to_owned() };
    let mut missing = Vec::new();
    let mut is_removed = |method: &str| {
        let found = REMOVED.into_iter().find(|removed| *removed == method);
        missing.extend(found);
        found.is_some()
    };
    if let Some(solvers) = inner(&mut recipe, "evaluate", "solvers").and_then(Item::as_array_mut) {
        let is_some = !solvers.is_empty();
        solvers.retain(|solver| !solver.as_str().is_some_and(&mut is_removed));
        if is_some && solvers.is_empty() {
            solvers.push(BEST);
        }
    }
    if let Some(method) = inner(&mut recipe, "accept", "method")
        && method.as_str().is_some_and(&mut is_removed)
    {
        *method = value(BEST);
    }
    missing.sort_unstable();
    missing.dedup();
    if missing.is_empty() {
        return text.to_owned();
    }
    note(&format!(
        "note: {name}: {} was removed from palpate; the other methods of the recipe are used, or else {BEST}",
        missing.join(" and ")
    ));
    recipe.to_string()
}

fn inner<'d>(recipe: &'d mut DocumentMut, table: &str, key: &str) -> Option<&'d mut Item> {
    recipe.get_mut(table)?.get_mut(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    fn remaining(text: &str) -> (String, Vec<String>) {
        let notes = RefCell::new(Vec::new());
        let kept = with_remaining_methods("run", text, &|note| notes.borrow_mut().push(note.to_owned()));
        (kept, notes.into_inner())
    }

    #[test]
    fn the_other_methods_remain_and_one_line_names_the_missing() {
        let (kept, notes) = remaining("[evaluate]\nsolvers = [\"whitened\", \"pearson\", \"pearson-knn\"]\n");
        assert!(kept.contains("\"pearson\"") && !kept.contains("whitened") && !kept.contains("knn"), "{kept}");
        assert!(notes.len() == 1 && notes[0].contains("pearson-knn and whitened was removed"), "{notes:?}");
        let (kept, notes) = remaining("evaluate = { solvers = [\"whitened\"] }\n[accept]\nmethod = \"whitened\"\n");
        assert_eq!((kept.matches("\"best\"").count(), notes.len()), (2, 1), "{kept}");
        for text in ["[evaluate]\nsolvers = [\"pearson\"] # as it is\n", "not = = toml", ""] {
            assert_eq!(remaining(text), (text.to_owned(), Vec::new()));
        }
    }
}
