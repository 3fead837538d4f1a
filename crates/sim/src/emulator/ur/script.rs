//! Programs of URScript, as far as clients of this emulator need it (document: "URScript manual").
//!
//! A program is a `def` or a `sec` with its `end`, or one line. It is read as a whole before any of it is run.

/// A program.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Program {
    pub steps: Vec<Step>,
    /// Whether it is a secondary program (`sec`), which runs beside another one.
    pub is_secondary: bool,
}

/// Step of a program.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    Do(Command),
    /// Chooses by a condition.
    If(Condition, Vec<Step>, Vec<Step>),
}

/// Condition: each pose (`None`: the present one) must be within reach, or not, as the first value says.
pub(super) type Condition = Vec<(bool, Option<[f64; 6]>)>;

/// Statement. Poses are in m and rad; `None` is the present pose.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Command {
    /// Target, acceleration, m/s^2, speed, m/s, and time, s, which has precedence unless it is 0.
    MoveLinear(Option<[f64; 6]>, [f64; 3]),
    Sleep(f64),
    WriteInteger(usize, i32),
    WriteFloat(usize, f64),
    WriteBit(usize, bool),
    SetTcp([f64; 6]),
    /// Mass, kg, and centre of gravity, m.
    SetPayload(f64, [f64; 3]),
    /// A statement without an effect here.
    Nothing,
}

/// Value of an argument.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Number(f64),
    Bool(bool),
    Text,
    List(Vec<f64>),
    Pose([f64; 6]),
    Here,
}

/// Takes the lines of the next whole program from the front. Blocks are counted, since indentation has no meaning.
pub(super) fn take_program(received: &mut Vec<u8>) -> Option<Vec<u8>> {
    let (mut depth, mut end) = (0_usize, 0);
    while let Some(length) = received[end..].iter().position(|&byte| byte == b'\n') {
        let line = String::from_utf8_lossy(&received[end..end + length]).into_owned();
        end += length + 1;
        let line = bare(&line);
        if line.is_empty() && depth == 0 {
            received.drain(..end);
            end = 0;
            continue;
        }
        let word = line.split(|char: char| !char.is_ascii_alphanumeric() && char != '_').next().unwrap_or("");
        match word {
            "def" | "sec" | "thread" | "if" | "while" | "for" => depth += 1,
            "end" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return Some(received.drain(..end).collect());
        }
    }
    None
}

impl Program {
    /// Reads a program; `None` for a syntax error or a statement that isn't known here.
    pub(super) fn read(text: &[u8]) -> Option<Program> {
        let text = std::str::from_utf8(text).ok()?;
        let mut lines = text.lines().map(bare).filter(|line| !line.is_empty()).peekable();
        let first = *lines.peek()?;
        let Some((word, name)) = ["def", "sec"].into_iter().find_map(|word| Some((word, first.strip_prefix(word)?)))
        else {
            return Some(Program { steps: vec![Step::Do(Command::read(first)?)], is_secondary: false });
        };
        let name = name.strip_prefix(' ')?.trim().strip_suffix(':')?.trim_end().strip_suffix("()")?;
        lines.next();
        let (steps, end) = block(&mut lines)?;
        let is_name = !name.is_empty() && name.chars().all(|char| char.is_ascii_alphanumeric() || char == '_');
        (is_name && end == "end" && lines.next().is_none()).then_some(Program { steps, is_secondary: word == "sec" })
    }
}

/// Reads the steps up to a line that ends the block, and returns that line, too.
fn block<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Option<(Vec<Step>, &'a str)> {
    let mut steps = Vec::new();
    loop {
        let line = lines.next()?;
        if line == "end" || line.strip_prefix("else").is_some_and(|rest| rest.trim() == ":") {
            return Some((steps, line));
        }
        let Some(condition) = line.strip_prefix("if").filter(|rest| rest.starts_with([' ', '('])) else {
            steps.push(Step::Do(Command::read(line)?));
            continue;
        };
        let condition =
            peeled(condition.trim().strip_suffix(':')?).split(" and ").map(question).collect::<Option<_>>()?;
        let (yes, end) = block(lines)?;
        let (no, end) = if end == "end" { (Vec::new(), end) } else { block(lines)? };
        if end != "end" {
            return None;
        }
        steps.push(Step::If(condition, yes, no));
    }
}

/// Reads a question: whether a pose is within reach, or not.
fn question(text: &str) -> Option<(bool, Option<[f64; 6]>)> {
    let text = peeled(text);
    let positive = text.strip_prefix("not").filter(|rest| rest.starts_with([' ', '(']));
    let (name, arguments) = call(peeled(positive.unwrap_or(text)))?;
    if !["is_within_safety_limits", "get_inverse_kin_has_solution"].contains(&name) {
        return None;
    }
    let [pose] = sorted(arguments, ["pose"])?;
    Some((positive.is_none(), target(pose?)?))
}

/// Returns an expression without spaces and parentheses around it.
fn peeled(mut text: &str) -> &str {
    loop {
        text = text.trim();
        let Some(inner) = text.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) else { return text };
        let mut depth = 0;
        let closes_inside = inner.chars().any(|char| {
            depth += i32::from(char == '(') - i32::from(char == ')');
            depth < 0
        });
        if closes_inside {
            return text;
        }
        text = inner;
    }
}

impl Command {
    fn read(line: &str) -> Option<Command> {
        let (name, arguments) = call(line)?;
        match name {
            "movel" => {
                let [pose, a, v, t, r] = sorted(arguments, ["pose", "a", "v", "t", "r"])?;
                number(r, Some(0.0))?;
                let limits = [number(a, Some(1.2))?, number(v, Some(0.25))?, number(t, Some(0.0))?];
                Some(Command::MoveLinear(target(pose?)?, limits))
            }
            // a program moves only while it waits for the motion, so there is nothing to stop
            "stopl" => sorted(arguments, ["a", "aRot"]).map(|_| Command::Nothing),
            "sync" => arguments.is_empty().then_some(Command::Sleep(super::CYCLE_S)),
            "textmsg" => sorted(arguments, ["s1", "s2"]).map(|_| Command::Nothing),
            "sleep" => {
                let [t] = sorted(arguments, ["t"])?;
                Some(Command::Sleep(number(t, None)?.max(0.0)))
            }
            "write_output_integer_register" => {
                let [n, value] = sorted(arguments, ["address", "value"])?;
                Some(Command::WriteInteger(address(n)?, number(value, None)? as i32))
            }
            "write_output_float_register" => {
                let [n, value] = sorted(arguments, ["address", "value"])?;
                Some(Command::WriteFloat(address(n)?, number(value, None)?))
            }
            "write_output_boolean_register" => {
                let [n, value] = sorted(arguments, ["address", "value"])?;
                let Value::Bool(value) = value? else { return None };
                Some(Command::WriteBit(address(n)?, value))
            }
            "set_tcp" => {
                let [pose, _] = sorted(arguments, ["pose", "tcp_name"])?;
                Some(Command::SetTcp(target(pose?)??))
            }
            "set_payload" => {
                let [mass, cog, _] = sorted(arguments, ["m", "cog", "inertia"])?;
                let cog_m = match cog {
                    None => [0.0; 3],
                    Some(Value::List(cog)) => cog.try_into().ok()?,
                    Some(_) => return None,
                };
                Some(Command::SetPayload(number(mass, None)?, cog_m))
            }
            _ => None,
        }
    }
}

/// Returns a line without its comment and the spaces around it.
fn bare(line: &str) -> &str {
    let comment = line.match_indices('#').find(|(at, _)| line[..*at].matches('"').count().is_multiple_of(2));
    line[..comment.map_or(line.len(), |(at, _)| at)].trim()
}

/// Splits a call into its name and its arguments.
fn call(text: &str) -> Option<(&str, Vec<&str>)> {
    let (name, rest) = text.split_once('(')?;
    let inner = rest.trim_end().strip_suffix(')')?;
    let (mut arguments, mut start, mut depth, mut quoted) = (Vec::new(), 0, 0_i32, false);
    for (at, char) in inner.char_indices() {
        match char {
            '"' => quoted = !quoted,
            _ if quoted => {}
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            ',' if depth == 0 => {
                arguments.push(inner[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
        if depth < 0 {
            return None;
        }
    }
    if !inner.trim().is_empty() {
        arguments.push(inner[start..].trim());
    }
    (depth == 0 && !quoted).then_some((name.trim(), arguments))
}

/// Assigns arguments to parameters, by position or by name.
fn sorted<const N: usize>(arguments: Vec<&str>, names: [&str; N]) -> Option<[Option<Value>; N]> {
    let mut values = [const { None }; N];
    for (position, argument) in arguments.into_iter().enumerate() {
        let named = argument.split_once('=').filter(|(name, _)| names.contains(&name.trim()));
        let (position, text) = match named {
            Some((name, text)) => (names.iter().position(|known| *known == name.trim())?, text),
            None => (position, argument),
        };
        *values.get_mut(position).filter(|value| value.is_none())? = Some(Value::read(text.trim())?);
    }
    Some(values)
}

impl Value {
    fn read(text: &str) -> Option<Value> {
        let list = |text: &str| -> Option<Vec<f64>> {
            let inner = text.strip_prefix('[')?.strip_suffix(']')?;
            inner.split(',').map(|part| finite(part.trim())).collect()
        };
        match text {
            "True" => Some(Value::Bool(true)),
            "False" => Some(Value::Bool(false)),
            "get_actual_tcp_pose()" => Some(Value::Here),
            _ if text.len() > 1 && text.starts_with('"') && text.ends_with('"') => Some(Value::Text),
            _ if text.starts_with('p') => Some(Value::Pose(list(&text[1..])?.try_into().ok()?)),
            _ if text.starts_with('[') => list(text).map(Value::List),
            _ => finite(text).map(Value::Number),
        }
    }
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

fn number(value: Option<Value>, default: Option<f64>) -> Option<f64> {
    match value {
        Some(Value::Number(number)) => Some(number),
        None => default,
        Some(_) => None,
    }
}

fn address(value: Option<Value>) -> Option<usize> {
    number(value, None).filter(|&number| number >= 0.0 && number.fract() == 0.0).map(|number| number as usize)
}

fn target(value: Value) -> Option<Option<[f64; 6]>> {
    match value {
        Value::Pose(pose) => Some(Some(pose)),
        Value::Here => Some(None),
        _ => None,
    }
}
