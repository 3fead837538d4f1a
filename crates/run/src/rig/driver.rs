//! Finds the driver of each role, and its link.

use super::family::{Beside, DeviceFamily, FAMILIES, Links, Role};
use super::keys::{array, load_cell, stage};
use super::spec::{ArrayDriver, Driver, LoadCellDriver, StageDriver};
use palpate_document::{Key, Problem, Table};
use palpate_link::wire::Link;
use std::sync::Arc;

/// Reads the stage's `driver` and `link`.
pub(super) fn read_stage_driver(table: &Table, beside: Beside) -> Option<(Arc<dyn StageDriver>, Link)> {
    read(table, [&stage::driver, &stage::link], |family| family.stage.as_ref(), beside)
}

/// Reads the load cell's `driver` and `link`.
pub(super) fn read_load_cell_driver(table: &Table, beside: Beside) -> Option<(Arc<dyn LoadCellDriver>, Link)> {
    read(table, [&load_cell::driver, &load_cell::link], |family| family.load_cell.as_ref(), beside)
}

/// Reads the array's `driver` and `link`.
pub(super) fn read_array_driver(table: &Table, beside: Beside) -> Option<(Arc<dyn ArrayDriver>, Link)> {
    read(table, [&array::driver, &array::link], |family| family.array.as_ref(), beside)
}

/// Reads `driver = "WORD"` or `{ NAME = ..., ... }` with the family that it names, and `link`.
fn read<D: Driver + ?Sized + 'static>(
    table: &Table,
    [key, link]: [&Key; 2],
    role: fn(&'static DeviceFamily) -> Option<&'static Role<D>>,
    beside: Beside,
) -> Option<(Arc<D>, Link)> {
    let roles = FAMILIES.into_iter().filter_map(role);
    let meanings: Vec<_> = roles.clone().flat_map(|role| role.words.iter().map(move |word| (*word, role))).collect();
    if table.is_text(key) && !meanings.is_empty() {
        let role = table.word(key, &meanings)?;
        let link = read_link(table, link, None, role.links);
        return (role.read)(table, beside).zip(link);
    }
    let inner = table.table(key)?;
    let named = inner.case();
    let Some(role) = roles.clone().find(|role| role.keys.first().map(|key| key.name) == named && named.is_some())
    else {
        let words: Vec<&str> = roles.clone().flat_map(|role| role.words).copied().collect();
        let names: Vec<&str> = roles.filter_map(|role| role.keys.first()).map(|key| key.name).collect();
        let alone = if words.is_empty() { String::new() } else { format!(", or only a name: {}", words.join(", ")) };
        let text = format!("unknown driver: expected one of {}{alone}", names.join(", "));
        inner.complain(Problem::new(inner.span(), text));
        return None;
    };
    let driver = (role.read)(&inner, beside);
    let own = driver.as_ref().and_then(|driver| driver.own_link());
    // the driver's own problems come first where the link depends on them
    if driver.is_none() && role.links == Links::Program {
        return None;
    }
    let link = read_link(table, link, own, role.links);
    driver.zip(link)
}

/// Reads `link = "..."`, which must be a link that the driver accepts, or `sim`. Returns `own` if the key is missing.
fn read_link(table: &Table, key: &Key, own: Option<Link>, links: Links) -> Option<Link> {
    let expected = match links {
        Links::Stream => "sim, serial://PORT?baud=RATE or tcp://HOST:PORT",
        Links::StreamOrDatagrams => "sim, serial://PORT?baud=RATE, tcp://HOST:PORT or udp://HOST:PORT",
        Links::Daqmx => "sim, daqmx, or daqmx:///PATH/OF/THE/LIBRARY",
        Links::Program => "sim, or no link",
    };
    if own.is_some() && !table.has(key) {
        return own;
    }
    if !table.require_as(key, &format!("address: {expected}")) {
        return None;
    }
    let text = table.text(key)?;
    let is_stream = matches!(links, Links::Stream | Links::StreamOrDatagrams);
    let fits = |link: &Link| match link {
        Link::Sim => true,
        Link::Serial { .. } | Link::Tcp { .. } => is_stream,
        Link::Udp { .. } => links == Links::StreamOrDatagrams,
        Link::Daqmx(_) => links == Links::Daqmx,
        Link::Process(_) | Link::Emulated(_) => false,
    };
    let is_port = is_stream && (text.starts_with("COM") || text.starts_with("/dev/"));
    let words = match Link::parse(text) {
        Ok(link) if fits(&link) => return Some(link),
        Err(words) if text.contains("://") => format!("`link` is \"{text}\", {words}"),
        _ => format!("`link` is \"{text}\", expected {expected}"),
    };
    let problem = Problem::new(table.span_of(key), words);
    table.complain(match is_port {
        true => problem.help(format!("write \"serial://{text}?baud=115200\", with the baud rate of the device")),
        false => problem,
    });
    None
}
