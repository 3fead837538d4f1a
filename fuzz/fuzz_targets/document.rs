//! Recipes and rigs of arbitrary text: a sound one or its problems, each at a place in the text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_data::recipe;
use palpate_run::rig;

const MAP: &str = include_str!("../../profiles/generic-rs485.toml");

fuzz_target!(|text: &str| {
    if let Err(problems) = recipe::parse("recipe.toml", text) {
        assert!(problems.text().count() > 0);
    }
    if let Err(problems) = rig::parse("rig.toml", text, &|_| Ok(MAP.to_owned())) {
        assert!(problems.text().count() > 0);
    }
});
