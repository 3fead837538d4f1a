//! Arrays of numpy: an archive with an .npy file for each (NEP 1, numpy/lib/format.py).

use super::variables::{Variable, VariableValues, transposed};
use crate::dataset::table_error::{MAX_ROWS, MAX_TABLE_BYTES};
use std::fs::File;
use std::io::{BufReader, Read};
use zip::ZipArchive;

/// Reads the arrays of one or two dimensions.
pub(crate) fn read(input: File) -> Result<Vec<Variable>, String> {
    let failed = |error: &dyn std::fmt::Display| format!("not an .npz file that can be read ({error})");
    let mut archive = ZipArchive::new(BufReader::new(input)).map_err(|error| failed(&error))?;
    let (mut variables, mut left) = (Vec::new(), MAX_TABLE_BYTES);
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|error| failed(&error))?;
        let name = entry.name().map_err(|error| failed(&error))?.into_owned();
        let Some(name) = name.strip_suffix(".npy") else { continue };
        let mut bytes = Vec::new();
        entry.take(left + 1).read_to_end(&mut bytes).map_err(|error| failed(&error))?;
        left = left.checked_sub(bytes.len() as u64).ok_or(format!("more than {MAX_TABLE_BYTES} bytes"))?;
        variables.extend(variable(name, &bytes).map_err(|problem| format!("array {name}: {problem}"))?);
    }
    Ok(variables)
}

/// Reads an array; `None` if it has no or more than two dimensions.
fn variable(name: &str, bytes: &[u8]) -> Result<Option<Variable>, String> {
    let cut = || "it is cut off".to_owned();
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or("not an array of numpy")?;
    let (header, data) = match rest.first().ok_or_else(cut)? {
        1 => split(rest.get(4..).ok_or_else(cut)?, u16::from_le_bytes([rest[2], rest[3]]).into()),
        _ => {
            let size = rest.get(2..6).and_then(|size| size.try_into().ok()).ok_or_else(cut)?;
            split(&rest[6..], u32::from_le_bytes(size) as usize)
        }
    }
    .ok_or_else(cut)?;
    let header = String::from_utf8_lossy(header);
    let after = |key: &str| Some(header.split_once(&format!("'{key}':"))?.1.trim_start());
    let unknown = || format!("its header isn't understood: {header}");
    let kind = after("descr").and_then(|rest| rest.strip_prefix('\'')?.split('\'').next());
    let Some(kind) = kind else { return Err("it is an array of records: save each column as an array".to_owned()) };
    let is_fortran = after("fortran_order").ok_or_else(unknown)?.starts_with("True");
    let shape = after("shape").and_then(|rest| rest.strip_prefix('(')?.split(')').next()).ok_or_else(unknown)?;
    let shape = shape.split(',').map(str::trim).filter(|count| !count.is_empty());
    let shape: Vec<usize> = shape.map(str::parse).collect::<Result<_, _>>().map_err(|_| unknown())?;
    let (rows, across) = match shape[..] {
        [rows] => (rows, 1),
        [1, rows] => (rows, 1),
        [rows, across] => (rows, across),
        _ => return Ok(None),
    };
    let count = rows.checked_mul(across).ok_or_else(unknown)?;
    let cells = cells(kind, data, count)?;
    let cells = if is_fortran || across == 1 { cells } else { in_columns(cells, rows) };
    Ok((count > 0).then(|| Variable { name: name.to_owned(), rows, cells }))
}

/// Splits the first bytes off.
fn split(bytes: &[u8], at: usize) -> Option<(&[u8], &[u8])> {
    bytes.split_at_checked(at)
}

fn cells(kind: &str, data: &[u8], count: usize) -> Result<VariableValues, String> {
    let is_big = kind.starts_with('>');
    let word = kind.trim_start_matches(['<', '>', '|', '=']);
    let unknown = || format!("values of the type {kind} can't be read: save numbers or texts");
    let (class, size) = word.split_at_checked(1).ok_or_else(unknown)?;
    let size: usize = size.parse().map_err(|_| unknown())?;
    let bytes = if class == "U" { size.saturating_mul(4) } else { size };
    let needed = count.checked_mul(bytes).filter(|needed| *needed <= data.len()).ok_or("it is cut off")?;
    // numpy writes no values of no bytes, except empty texts
    let each = || data[..needed].chunks_exact(bytes.max(1));
    let ordered = |chunk: &[u8]| {
        let mut eight = [0; 8];
        eight[..chunk.len()].copy_from_slice(chunk);
        if is_big {
            eight[..chunk.len()].reverse();
        }
        u64::from_le_bytes(eight)
    };
    Ok(match (class, size) {
        ("f", 8) => VariableValues::Numbers(each().map(|chunk| f64::from_bits(ordered(chunk))).collect()),
        ("f", 4) => VariableValues::Numbers(each().map(|chunk| f32::from_bits(ordered(chunk) as u32).into()).collect()),
        ("u", 8) => VariableValues::Texts(each().map(|chunk| ordered(chunk).to_string()).collect()),
        ("b" | "u", 1 | 2 | 4) => VariableValues::Counts(each().map(|chunk| ordered(chunk) as i64).collect()),
        ("i", 1 | 2 | 4 | 8) => {
            let unused = 64 - 8 * size as u32;
            VariableValues::Counts(each().map(|chunk| (ordered(chunk) << unused) as i64 >> unused).collect())
        }
        ("U", 0) if count <= MAX_ROWS => VariableValues::Texts(vec![String::new(); count]),
        ("U", 1..) => {
            let letters = |text: &[u8]| -> String {
                let letters =
                    text.chunks_exact(4).map(|letter| ordered(letter) as u32).take_while(|letter| *letter != 0);
                letters.map(|letter| char::from_u32(letter).unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
            };
            VariableValues::Texts(each().map(letters).collect())
        }
        _ => return Err(unknown()),
    })
}

fn in_columns(cells: VariableValues, rows: usize) -> VariableValues {
    match cells {
        VariableValues::Numbers(values) => VariableValues::Numbers(transposed(&values, rows)),
        VariableValues::Counts(values) => VariableValues::Counts(transposed(&values, rows)),
        VariableValues::Texts(values) => VariableValues::Texts(transposed(&values, rows)),
    }
}
