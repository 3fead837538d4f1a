//! `palpate drivers`: the families of devices that a rig may name.

use super::output::OutputArgs;
use super::summary::beside;
use crate::api::Failure;
use palpate_run::rig::{DeviceFamily, FAMILIES, Links};
use serde_json::{Value, json};
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
pub(super) struct DriversArgs {
    #[command(flatten)]
    output: OutputArgs,
}

/// Lists the families, a paragraph each.
pub(super) fn drivers(args: &DriversArgs) -> Result<ExitCode, Failure> {
    args.output.print(&FAMILIES.map(paragraph).join("\n"), &json!({ "drivers": FAMILIES.map(object) }))?;
    Ok(ExitCode::SUCCESS)
}

fn paragraph(family: &DeviceFamily) -> String {
    let (roles, link) = roles_and_link(family);
    beside(family.name, INDENT, family.meaning)
        + &beside("  roles", INDENT, &roles.join(", "))
        + &beside("  link", INDENT, link)
        + &beside("  simulated", INDENT, family.simulated)
}

fn object(family: &DeviceFamily) -> Value {
    let (roles, link) = roles_and_link(family);
    let DeviceFamily { name, meaning, simulated, .. } = family;
    json!({ "name": name, "meaning": meaning, "roles": roles, "link": link, "simulated": simulated })
}

/// Returns the roles of a family, and its kind of link, which is the same in all roles.
fn roles_and_link(family: &DeviceFamily) -> (Vec<&'static str>, &'static str) {
    let roles = [
        family.stage.as_ref().map(|role| ("stage", role.links)),
        family.load_cell.as_ref().map(|role| ("load_cell", role.links)),
        family.array.as_ref().map(|role| ("array", role.links)),
    ];
    let (names, links): (Vec<&str>, Vec<Links>) = roles.into_iter().flatten().unzip();
    let link = links.first().map_or("", |links| match links {
        Links::Stream => "serial port or TCP",
        Links::StreamOrDatagrams => "serial port, TCP or UDP",
        Links::Daqmx => "NI's library",
        Links::Program => "the program itself",
    });
    (names, link)
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
            FAMILIES.into_iter().find(|family| family.name == "xps").map(paragraph).unwrap_or_default(),
            "xps         Newport XPS: three positioners in any groups, an analog input\n  \
             roles     stage, load_cell\n  \
             link      serial port or TCP\n  \
             simulated an XPS-Q8 with three VP-25XL axes, an input, a guard\n"
        );
    }
}
