//! `palpate drivers`: the families of devices that a rig may name.

use super::exit::Failure;
use super::summary::{beside, print};
use palpate_run::rig::{FAMILIES, Family, Links};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Example:
  palpate drivers

In a rig file, write driver = \"esp301\", or driver = { modbus = \"labjack-t7\" } with its keys.
Every family can be simulated: link = \"sim\", or --simulate.";

/// Column where the description of a family begins.
const INDENT: usize = 12;

/// List the device families that a rig can use
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DriversArgs {}

/// Lists the families, a paragraph each.
pub(super) fn drivers(_: &DriversArgs) -> Result<ExitCode, Failure> {
    print(&FAMILIES.map(paragraph).join("\n"))?;
    Ok(ExitCode::SUCCESS)
}

fn paragraph(family: &Family) -> String {
    let roles = [
        family.stage.as_ref().map(|role| ("stage", role.words, role.links)),
        family.load_cell.as_ref().map(|role| ("load_cell", role.words, role.links)),
        family.array.as_ref().map(|role| ("array", role.words, role.links)),
    ];
    let roles: Vec<_> = roles.into_iter().flatten().collect();
    let names: Vec<&str> = roles.iter().map(|(role, ..)| *role).collect();
    // a family has the same kind of link in all its roles
    let links = roles.first().map_or("", |(.., links)| match links {
        Links::Stream => "serial port or TCP",
        Links::Daqmx => "NI's library",
        Links::Program => "the program itself",
    });
    beside(family.name, INDENT, family.meaning)
        + &beside("  roles", INDENT, &names.join(", "))
        + &beside("  link", INDENT, links)
        + &beside("  simulated", INDENT, family.simulated)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_family_is_shown_with_its_roles_link_and_emulator_in_80_columns() {
        for family in FAMILIES {
            let text = paragraph(family);
            assert!(text.starts_with(family.name) && text.lines().count() >= 4, "{text}");
            assert!(text.lines().all(|line| line.chars().count() <= 80 && line == line.trim_end()), "{text}");
        }
        assert_eq!(
            paragraph(FAMILIES[4]),
            "xps         Newport XPS: three positioners in any groups, an analog input\n  \
             roles     stage, load_cell\n  \
             link      serial port or TCP\n  \
             simulated an XPS-Q8 with three VP-25XL axes, an input, a guard\n"
        );
    }
}
