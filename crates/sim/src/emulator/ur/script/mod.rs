//! Programs of URScript, as far as clients of this emulator need it (document: "URScript manual").
//!
//! A program is a `def` with its `end`. It is read as a whole before any of it is run.

/// A pose: m and rad, as a rotation vector.
pub(super) type Pose = [f64; 6];

/// Step of a program.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    /// Target, and the speed, m/s, and the acceleration, m/s^2.
    MoveLinear(Pose, [f64; 2]),
    /// Duration, s.
    Sleep(f64),
    /// Number of an integer register below 48, and its value.
    Write(usize, i32),
    /// Chooses by whether a condition is as `wanted` says.
    If { wanted: bool, condition: Condition, yes: Vec<Step>, no: Vec<Step> },
}

/// Condition of an `if`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Condition {
    /// A pose is within the safety limits.
    Within(Pose),
    /// An integer register is below a number.
    Below(usize, i32),
}

/// Takes the lines of the next whole program from the front. Blocks are counted, since indentation has no meaning.
pub(super) fn take_program(received: &mut Vec<u8>) -> Option<Vec<u8>> {
    let (mut depth, mut end) = (0_usize, 0);
    for line in received.split_inclusive(|&byte| byte == b'\n').filter(|line| line.ends_with(b"\n")) {
        end += line.len();
        let line = String::from_utf8_lossy(line);
        match bare(&line).split(|char: char| !char.is_ascii_alphanumeric() && char != '_').next() {
            Some("def" | "sec" | "thread" | "if" | "while" | "for") => depth += 1,
            Some("end") => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return Some(received.drain(..end).collect());
        }
    }
    None
}

/// Reads a program; `None` for a syntax error or a statement that isn't known here.
pub(super) fn read_program(text: &[u8]) -> Option<Vec<Step>> {
    let text = std::str::from_utf8(text).ok()?;
    let mut lines = text.lines().map(bare).filter(|line| !line.is_empty());
    let name = lines.next()?.strip_prefix("def ")?.strip_suffix(':')?.trim().strip_suffix("()")?;
    let is_name = !name.is_empty() && name.chars().all(|char| char.is_ascii_alphanumeric() || char == '_');
    let (steps, end) = read_block(&mut lines)?;
    (is_name && end == "end" && lines.next().is_none()).then_some(steps)
}

/// Reads the steps up to a line that ends the block, and returns that line, too.
fn read_block<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Option<(Vec<Step>, &'a str)> {
    let mut steps = Vec::new();
    loop {
        let line = lines.next()?;
        if line == "end" || line == "else:" {
            return Some((steps, line));
        }
        let Some(condition) = line.strip_prefix("if").filter(|rest| rest.starts_with([' ', '('])) else {
            steps.push(read_statement(line)?);
            continue;
        };
        let (wanted, condition) = read_condition(condition.strip_suffix(':')?)?;
        let (yes, end) = read_block(lines)?;
        let no = if end == "end" { Vec::new() } else { read_block(lines).filter(|(_, end)| *end == "end")?.0 };
        steps.push(Step::If { wanted, condition, yes, no });
    }
}

/// Reads a condition, and whether it or its opposite is wanted.
fn read_condition(text: &str) -> Option<(bool, Condition)> {
    let (mut text, mut wanted) = (text.trim(), true);
    loop {
        if let Some((read, limit)) = text.split_once('<') {
            let list = read.trim_matches(['(', ' ']).strip_prefix("read_output_integer_register")?;
            let register = arguments(list, ["address"])?[0]?.parse().ok().filter(|&register| register < 48)?;
            return Some((wanted, Condition::Below(register, number(limit.trim_matches([')', ' ']))? as i32)));
        } else if let Some(inner) = text.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
            text = inner.trim();
        } else if let Some(inner) = text.strip_prefix("not").filter(|rest| rest.starts_with([' ', '('])) {
            (text, wanted) = (inner.trim(), !wanted);
        } else {
            let list = text.strip_prefix("is_within_safety_limits")?;
            return Some((wanted, Condition::Within(read_pose(arguments(list, ["pose"])?[0]?)?)));
        }
    }
}

fn read_statement(line: &str) -> Option<Step> {
    let (name, list) = line.split_at(line.find('(')?);
    match name.trim_end() {
        "movel" => {
            let [pose, a, v, t, r] = arguments(list, ["pose", "a", "v", "t", "r"])?;
            let limits = [number(v.unwrap_or("0.25"))?, number(a.unwrap_or("1.2"))?];
            let is_known = number(t.unwrap_or("0"))? == 0.0 && number(r.unwrap_or("0")).is_some();
            (is_known && limits.iter().all(|&limit| limit > 0.0)).then_some(Step::MoveLinear(read_pose(pose?)?, limits))
        }
        // a program moves only while it waits for the motion, so there is nothing to stop
        "stopl" => arguments(list, ["a", "aRot"]).map(|_| Step::Sleep(0.0)),
        "sleep" => Some(Step::Sleep(number(arguments(list, ["t"])?[0]?)?.max(0.0))),
        "write_output_integer_register" => {
            let [register, value] = arguments(list, ["address", "value"])?;
            let register = register?.parse().ok().filter(|&register| register < 48)?;
            Some(Step::Write(register, number(value?)? as i32))
        }
        _ => None,
    }
}

/// Returns a line without its comment and the spaces around it.
fn bare(line: &str) -> &str {
    line.split('#').next().unwrap_or(line).trim()
}

/// Splits a list of arguments in parentheses, and assigns them to parameters, by position or by name.
fn arguments<'a, const N: usize>(list: &'a str, names: [&str; N]) -> Option<[Option<&'a str>; N]> {
    let inner = list.trim().strip_prefix('(')?.strip_suffix(')')?;
    let (mut values, mut depth) = ([None; N], 0);
    let parts = inner.split(|char| {
        depth += i32::from(char == '[') - i32::from(char == ']');
        char == ',' && depth == 0
    });
    for (position, part) in parts.enumerate() {
        let (position, text) = match part.split_once('=') {
            Some((name, text)) => (names.iter().position(|known| *known == name.trim())?, text),
            None => (position, part),
        };
        *values.get_mut(position).filter(|value| value.is_none())? = Some(text.trim());
    }
    Some(values)
}

fn read_pose(text: &str) -> Option<Pose> {
    let parts: Option<Vec<f64>> = text.strip_prefix("p[")?.strip_suffix(']')?.split(',').map(number).collect();
    parts?.try_into().ok()
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}
