//! A register map that a rig names.

use crate::document::{Key, Problem, Table, with_nearest};
use crate::driver::modbus::{Profile, SHIPPED};

/// A Modbus register map and where it came from.
#[derive(Clone, Debug)]
pub struct MappedDevice {
    /// The name in the rig file: one that came with the program, or a file beside the rig's.
    pub name: String,
    /// The map.
    pub profile: Profile,
    /// The text of a map of the user's own; none where it came with the program.
    pub own_text: Option<String>,
}

/// Gives the text of a file that lies beside the rig's.
pub(super) type Beside<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

/// `modbus = "NAME"`, a map that came with the program or a file beside the rig's.
pub(super) fn read_map(
    driver: &Table,
    key: &Key,
    part: &str,
    fits: impl Fn(&Profile) -> bool,
    beside: Beside,
) -> Option<MappedDevice> {
    let span = driver.span_of(key);
    let name = driver.text(key)?;
    let map = if let Some(profile) = Profile::shipped(name) {
        MappedDevice { name: name.to_owned(), profile, own_text: None }
    } else {
        let known = || SHIPPED.map(|(name, _)| name).join(", ");
        let plain = !name.contains(['/', '\\']) && name.ends_with(".toml");
        if !plain {
            let told = format!("there is no register map \"{name}\"");
            let help = format!("known: {}; or name a .toml file that lies beside this one", known());
            let problem = Problem::new(span, told).help(help);
            driver.complain(with_nearest(problem, name, &SHIPPED.map(|(name, _)| name)));
            return None;
        }
        let text = match beside(name) {
            Ok(text) => text,
            Err(error) => {
                let help = format!("it must lie beside the rig; maps that come with the program: {}", known());
                driver.complain(Problem::new(span, format!("{name}: {error}")).help(help));
                return None;
            }
        };
        match Profile::parse(name, &text) {
            Ok(profile) => MappedDevice { name: name.to_owned(), profile, own_text: Some(text) },
            Err(problems) => {
                // each with the map's own line
                problems.lines().into_iter().for_each(|line| driver.complain(Problem::new(span.clone(), line)));
                return None;
            }
        }
    };
    if !fits(&map.profile) {
        driver.complain(Problem::new(span, format!("the register map \"{name}\" has no [{part}]")));
        return None;
    }
    Some(map)
}
