//! The JSON Schemas of recipes and rigs in another validator.

use palpate_testing::python::{Python, said};
use palpate_testing::twins::{RECIPE_TWINS, RIG_TWINS, RefusedBy, Twin};
use palpate_testing::{SMALL, TestFolder, exchanged, shipped, shipped_text};
use std::path::PathBuf;

/// The files and folders in a shipped folder.
fn entries(folder: &str) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(shipped(folder)).unwrap().map(|entry| entry.unwrap().path())
}

/// The validator's result for each text, in their order.
fn judged(python: &Python, bench: &TestFolder, kind: &str, texts: &[PathBuf]) -> Vec<String> {
    bench.write("schema.json", &bench.palpate_ends(0, &format!("schema {kind}")).out);
    let words = [bench.path("schema.json")].into_iter().chain(texts.iter().cloned());
    let lines = said(python.script("schemas.py", words));
    lines.lines().map(|line| line.split_once(' ').map_or(line, |(_, verdict)| verdict).to_owned()).collect()
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn schemas_accept_shipped_files_and_refuse_wrong_ones() {
    let python = Python::with("import jsonschema, tomllib");
    let bench = TestFolder::new();
    let sim = shipped_text("rigs/sim.toml");
    for (kind, folder, whole, twins) in
        [("recipe", "recipes", SMALL, &RECIPE_TWINS[..]), ("rig", "rigs", &sim, &RIG_TWINS[..])]
    {
        let mut texts: Vec<PathBuf> = entries(folder).filter(|path| path.is_file()).collect();
        let of_protocols = entries("recipes/protocols").map(|protocol| protocol.join(format!("{kind}.toml")));
        texts.extend(of_protocols.filter(|path| path.exists()));
        let shipped = texts.len();
        for (index, Twin { from, to, .. }) in twins.iter().enumerate() {
            let name = format!("{kind}-{index}.toml");
            bench.write(&name, &exchanged(whole, from, to));
            texts.push(bench.path(&name));
        }
        let judged = judged(&python, &bench, kind, &texts);
        assert!(judged[..shipped].iter().all(|verdict| verdict == "accepted"), "{texts:?}: {judged:?}");
        for (twin, verdict) in twins.iter().zip(&judged[shipped..]) {
            let expected = match twin.refused_by {
                RefusedBy::Schema => "refused",
                RefusedBy::Program => "accepted",
                RefusedBy::Toml => "no TOML",
            };
            assert_eq!(verdict, expected, "{kind}: {}", twin.to);
        }
    }
}
