//! Variables of a MAT file of version 5 ("MAT-File Format", MathWorks, R2019b, chapter 1): numbers, texts, cells of texts, and
//! structs of these.

use super::variables::{Variable, VariableValues};
use crate::dataset::table_error::MAX_TABLE_BYTES;
use flate2::read::ZlibDecoder;
use std::fs::File;
use std::io::Read;

/// Types of data elements.
const INT8: u32 = 1;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Largest number of structs within each other that is read.
const DEPTH_MOST: usize = 4;

/// Reads the variables. The fields of a struct are named after it: `presses.x_mm`.
pub(crate) fn read(input: File) -> Result<Vec<Variable>, String> {
    let mut bytes = Vec::new();
    input.take(MAX_TABLE_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_TABLE_BYTES {
        return Err(format!("more than {MAX_TABLE_BYTES} bytes"));
    }
    if bytes.starts_with(b"MATLAB 7.3") || bytes.starts_with(b"\x89HDF") {
        return Err("a MAT file of version 7.3: save it with `save('name.mat', ..., '-v7')`".to_owned());
    }
    let is_little = bytes.get(126..128) == Some(b"IM");
    if !is_little || !bytes.starts_with(b"MATLAB 5.0") && bytes.get(125) != Some(&1) {
        return Err("not a MAT file of version 5 with the byte order of common machines".to_owned());
    }
    let (mut variables, mut left) = (Vec::new(), MAX_TABLE_BYTES);
    let mut rest = &bytes[128..];
    while !rest.is_empty() {
        let (kind, content, next) = element(rest)?;
        rest = next;
        if kind == COMPRESSED {
            let mut unpacked = Vec::new();
            let read = ZlibDecoder::new(content).take(left + 1).read_to_end(&mut unpacked);
            read.map_err(|error| format!("a variable can't be unpacked: {error}"))?;
            left = left.checked_sub(unpacked.len() as u64).ok_or(format!("more than {MAX_TABLE_BYTES} bytes"))?;
            let (kind, content, _) = element(&unpacked)?;
            if kind == MATRIX {
                array("", content, 0, &mut variables)?;
            }
        } else if kind == MATRIX {
            array("", content, 0, &mut variables)?;
        }
    }
    Ok(variables)
}

/// Splits the first data element off: its type, its bytes, and the rest.
fn element(bytes: &[u8]) -> Result<(u32, &[u8], &[u8]), String> {
    let cut = || "the file is cut off".to_owned();
    let word = |at: usize| bytes.get(at..at + 4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
    let tag = word(0).ok_or_else(cut)?;
    if tag >> 16 != 0 {
        // a small element has its bytes within its tag
        let content = bytes.get(4..4 + (tag >> 16).min(4) as usize).ok_or_else(cut)?;
        return Ok((tag & 0xFFFF, content, bytes.get(8..).ok_or_else(cut)?));
    }
    let size = word(4).ok_or_else(cut)? as usize;
    let content = bytes.get(8..8 + size).ok_or_else(cut)?;
    // compressed elements aren't filled up, and neither is the last
    let end = if tag == COMPRESSED { 8 + size } else { (8 + size).next_multiple_of(8).min(bytes.len()) };
    Ok((tag, content, &bytes[end..]))
}

/// Reads an array with the name that it has, or that its struct gives it. Arrays of other classes are left out.
fn array(given: &str, content: &[u8], depth: usize, variables: &mut Vec<Variable>) -> Result<(), String> {
    if content.is_empty() {
        return Ok(()); // an empty field
    }
    let (_, flags, rest) = element(content)?;
    let (_, shape, rest) = element(rest)?;
    let (_, own, rest) = element(rest)?;
    let name = if given.is_empty() { String::from_utf8_lossy(own).into_owned() } else { given.to_owned() };
    let class = flags.first().copied().unwrap_or_default();
    let is_complex = flags.get(1).is_some_and(|flags| flags & 0x08 != 0);
    let counts = shape.chunks_exact(4).map(|count| i32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let shape: Vec<usize> = counts.map(|count| usize::try_from(count).unwrap_or_default()).collect();
    let [rows, across] = shape[..] else { return Ok(()) };
    let count = rows.checked_mul(across).ok_or("the shape of an array is too large")?;
    // a row of values is a column too
    let rows = if rows == 1 { across } else { rows };
    let mut add = |cells: VariableValues| {
        if cells.len() == count && count > 0 {
            variables.push(Variable { name: name.clone(), rows, cells });
        }
    };
    match class {
        1 => {
            if let Some(texts) = texts(rest, count)? {
                add(VariableValues::Texts(texts));
            }
        }
        2 if count == 1 && depth < DEPTH_MOST => {
            let (_, length, rest) = element(rest)?;
            let length = length.first().copied().unwrap_or(32).max(1).into();
            let (kind, names, mut rest) = element(rest)?;
            if kind != INT8 {
                return Err(format!("the names of the fields of {name} can't be read"));
            }
            for field in names.chunks_exact(length) {
                let field = field.split(|byte| *byte == 0).next().unwrap_or_default();
                let (_, content, next) = element(rest)?;
                rest = next;
                let field = format!("{name}.{}", String::from_utf8_lossy(field));
                array(&field, content, depth + 1, variables)?;
            }
        }
        6..=15 if !is_complex => add(numbers(class, element(rest)?)),
        _ => {}
    }
    Ok(())
}

/// Numbers of any type, which the class doesn't state: doubles are stored as bytes where they are whole and small.
fn numbers(class: u8, (kind, bytes, _): (u32, &[u8], &[u8])) -> VariableValues {
    fn each<const N: usize, T>(bytes: &[u8], of: fn([u8; N]) -> T) -> Vec<T> {
        bytes.as_chunks::<N>().0.iter().map(|chunk| of(*chunk)).collect()
    }
    let counts = match kind {
        1 => each(bytes, |[byte]: [u8; 1]| i64::from(byte as i8)),
        2 => each(bytes, |[byte]: [u8; 1]| i64::from(byte)),
        3 => each(bytes, |two| i64::from(i16::from_le_bytes(two))),
        4 => each(bytes, |two| i64::from(u16::from_le_bytes(two))),
        5 => each(bytes, |four| i64::from(i32::from_le_bytes(four))),
        6 => each(bytes, |four| i64::from(u32::from_le_bytes(four))),
        7 => return VariableValues::Numbers(each(bytes, |four| f32::from_le_bytes(four).into())),
        9 => return VariableValues::Numbers(each(bytes, f64::from_le_bytes)),
        12 => each(bytes, i64::from_le_bytes),
        13 => return VariableValues::Texts(each(bytes, |eight| u64::from_le_bytes(eight).to_string())),
        _ => Vec::new(),
    };
    // 6 and 7 are double and single
    if matches!(class, 6 | 7) {
        VariableValues::Numbers(counts.iter().map(|count| *count as f64).collect())
    } else {
        VariableValues::Counts(counts)
    }
}

/// Texts of a cell array; `None` if a cell has something else.
fn texts(mut rest: &[u8], count: usize) -> Result<Option<Vec<String>>, String> {
    let mut texts = Vec::new();
    for _ in 0..count {
        let (_, content, next) = element(rest)?;
        rest = next;
        let (_, flags, its) = element(content)?;
        let (_, _, its) = element(its)?;
        let (_, _, its) = element(its)?;
        if flags.first() != Some(&4) {
            return Ok(None);
        }
        // an empty text may have no content
        let (kind, letters, _) = if its.is_empty() { (INT8, its, its) } else { element(its)? };
        let wide = || letters.as_chunks::<2>().0.iter().map(|letter| u16::from_le_bytes(*letter));
        texts.push(match kind {
            4 | 17 => char::decode_utf16(wide()).map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER)).collect(),
            _ => String::from_utf8_lossy(letters).into_owned(),
        });
    }
    Ok(Some(texts))
}
