//! A line of G-code: a command and its parameters (Klipper's klippy/gcode.py).

/// Largest number that is read. Klipper has no such limit.
const MOST: f64 = 1e9;

/// A line of a script.
pub(super) struct GcodeLine<'a> {
    /// The command in capitals, such as `G1` or `SET_GCODE_OFFSET`. Empty without one.
    pub command: String,
    /// The line as errors quote it.
    pub text: &'a str,
    /// Names and values; `None` if an extended command has a word without a value.
    params: Option<Vec<(String, String)>>,
}

impl<'a> GcodeLine<'a> {
    /// Reads a line. A traditional command is a letter and a number, and its parameters are letters with values. An extended
    /// command has parameters of the form `NAME=value`.
    pub(super) fn parse(line: &'a str) -> Self {
        let text = line.trim();
        let code = text.split(';').next().unwrap_or_default().to_uppercase();
        // names are runs of capitals, values are what is between them
        let mut words = vec![(String::new(), String::new())];
        let mut in_name = false;
        for char in code.chars() {
            let is_name = char.is_ascii_uppercase() || char == '_' || char == '*';
            if is_name && (!in_name || char == '*') {
                words.push(Default::default());
            }
            if let Some((name, value)) = words.last_mut() {
                if is_name { name.push(char) } else { value.push(char) }
            }
            in_name = is_name && char != '*';
        }
        let numbered = words[0].1.is_empty() && words.get(1).is_some_and(|(name, _)| name == "N");
        let first = words.get(if numbered { 2 } else { 1 }).cloned().unwrap_or_default();
        let before = if numbered { "" } else { &words[0].1 };
        let command = format!("{before}{}{}", first.0, first.1).trim().to_owned();
        let traditional = command.as_bytes().get(1).is_some_and(u8::is_ascii_digit);
        let params = if traditional {
            Some(words.into_iter().map(|(name, value)| (name, value.trim().to_owned())).collect())
        } else {
            let rest = text.split(['#', ';']).next().unwrap_or_default().split_whitespace().skip(1);
            let pair = |word: &str| {
                word.split_once('=').map(|(name, value)| (name.to_uppercase(), value.trim_matches('"').to_owned()))
            };
            rest.map(pair).collect()
        };
        GcodeLine { command, text, params }
    }

    /// Value of a parameter, which may be empty.
    pub(super) fn get(&self, name: &str) -> Result<Option<&str>, String> {
        let params = self.params.as_ref().ok_or_else(|| format!("Malformed command '{}'", self.text))?;
        // of two, the last counts
        Ok(params.iter().rev().find(|(other, _)| other == name).map(|(_, value)| value.as_str()))
    }

    /// A number, if the parameter is there.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.get(name)? else { return Ok(None) };
        let number = value.parse().ok().filter(|number: &f64| number.abs() <= MOST);
        number.map(Some).ok_or_else(|| format!("Error on '{}': unable to parse {value}", self.text))
    }

    /// A number above zero, if the parameter is there.
    pub(super) fn above_zero(&self, name: &str) -> Result<Option<f64>, String> {
        match self.number(name)? {
            Some(number) if number <= 0.0 => Err(format!("Error on '{}': {name} must be above 0.0", self.text)),
            number => Ok(number),
        }
    }

    /// A value that must be there.
    pub(super) fn needed<T>(&self, name: &str, value: Option<T>) -> Result<T, String> {
        value.ok_or_else(|| format!("Error on '{}': missing {name}", self.text))
    }

    /// Numbers of X, Y and Z.
    pub(super) fn axes(&self) -> Result<[Option<f64>; 3], String> {
        Ok([self.number("X")?, self.number("Y")?, self.number("Z")?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_a_command_and_parameters() {
        for (line, command) in [
            ("g1 x1.5Y-2 F600 ; right", "G1"),
            ("N12 G1 X1*71", "G1"),
            (" SET_GCODE_OFFSET z=0.1", "SET_GCODE_OFFSET"),
            ("; no command", ""),
            ("G28.1", "G28.1"),
            ("M117 5", "M117 5"),
        ] {
            assert_eq!(GcodeLine::parse(line).command, command, "{line}");
        }
        let line = GcodeLine::parse("G1 X1.5Y-2 Z");
        assert_eq!((line.number("X"), line.number("F")), (Ok(Some(1.5)), Ok(None)));
        assert_eq!(line.number("Z").unwrap_err(), "Error on 'G1 X1.5Y-2 Z': unable to parse ");
        assert_eq!(GcodeLine::parse("FOO a=1 B=x").get("B"), Ok(Some("x")));
        assert_eq!(GcodeLine::parse("FOO A").get("A").unwrap_err(), "Malformed command 'FOO A'");
    }
}
