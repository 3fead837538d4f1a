//! Expressions of URScript: how they are written.

use super::functions::Function;
use super::value::Value;

/// Largest depth of an expression, so that no text exhausts the stack.
const DEPTH_MOST: usize = 64;
/// Operators of two values: those that bind less first. `not` binds less than a comparison.
const BINARY: [&[&str]; 5] = [&["or"], &["and"], &["==", "!=", "<=", ">=", "<", ">"], &["+", "-"], &["*", "/"]];

/// An expression.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::emulator::ur) enum Expression {
    Constant(Value),
    Variable(String),
    /// A list, or with `true` a pose.
    List(Vec<Expression>, bool),
    /// An element of a list or a pose.
    Element(Box<Expression>, Box<Expression>),
    Not(Box<Expression>),
    Negative(Box<Expression>),
    Binary(&'static str, Box<[Expression; 2]>),
    Call(Call),
}

/// A call: a function, and its arguments by the positions of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::emulator::ur) struct Call {
    pub function: &'static Function,
    pub arguments: Vec<Option<Expression>>,
}

impl Expression {
    /// Reads an expression; `None` for a syntax error or an unknown function.
    pub(in crate::emulator::ur) fn read(text: &str) -> Option<Expression> {
        let tokens = tokens(text)?;
        let mut reader = Reader { rest: &tokens, depth: 0 };
        reader.expression(0).filter(|_| reader.rest.is_empty())
    }
}

#[derive(Clone, Debug, PartialEq)]
enum Token<'a> {
    Number(f64),
    Text(&'a str),
    Name(&'a str),
    /// An operator or a bracket.
    Sign(&'static str),
}

fn tokens(text: &str) -> Option<Vec<Token<'_>>> {
    const SIGNS: [&str; 16] = ["==", "!=", "<=", ">=", "<", ">", "=", "+", "-", "*", "/", "(", ")", "[", "]", ","];
    let mut tokens = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let (token, length) = if first.is_ascii_digit() || first == '.' {
            let mut length = rest.find(|char: char| !char.is_ascii_digit() && char != '.').unwrap_or(rest.len());
            if let Some(exponent) = rest[length..].strip_prefix(['e', 'E']) {
                let sign = usize::from(exponent.starts_with(['+', '-']));
                let digits = exponent[sign..].bytes().take_while(u8::is_ascii_digit).count();
                length += if digits > 0 { 1 + sign + digits } else { 0 };
            }
            (Token::Number(rest[..length].parse().ok()?), length)
        } else if let Some(quoted) = rest.strip_prefix('"') {
            let length = quoted.find('"')?;
            (Token::Text(&quoted[..length]), length + 2)
        } else if first.is_ascii_alphabetic() || first == '_' {
            let is_part = |char: char| char.is_ascii_alphanumeric() || char == '_';
            let length = rest.find(|char| !is_part(char)).unwrap_or(rest.len());
            (Token::Name(&rest[..length]), length)
        } else {
            let sign = SIGNS.into_iter().find(|sign| rest.starts_with(sign))?;
            (Token::Sign(sign), sign.len())
        };
        tokens.push(token);
        rest = rest[length..].trim_start();
    }
    Some(tokens)
}

/// Reads tokens from the front.
struct Reader<'a> {
    rest: &'a [Token<'a>],
    depth: usize,
}

impl Reader<'_> {
    /// Takes a sign if it is the next token.
    fn takes(&mut self, sign: &str) -> bool {
        let is_next = matches!(self.rest.first(), Some(Token::Sign(next)) if *next == sign);
        self.rest = if is_next { &self.rest[1..] } else { self.rest };
        is_next
    }

    /// Takes one of some operators.
    fn operator(&mut self, among: &[&'static str]) -> Option<&'static str> {
        let (Token::Sign(text) | Token::Name(text)) = self.rest.first()? else { return None };
        let found = among.iter().find(|operator| *operator == text)?;
        self.rest = &self.rest[1..];
        Some(found)
    }

    /// Reads operators that bind at least as much as a level of [`BINARY`].
    fn expression(&mut self, level: usize) -> Option<Expression> {
        let Some(operators) = BINARY.get(level) else { return self.unary() };
        if operators.contains(&"==") && self.operator(&["not"]).is_some() {
            return self.nested(|reader| reader.expression(level)).map(|value| Expression::Not(value.into()));
        }
        let mut left = self.expression(level + 1)?;
        while let Some(operator) = self.operator(operators) {
            left = Expression::Binary(operator, Box::new([left, self.expression(level + 1)?]));
        }
        Some(left)
    }

    /// Reads what is one level deeper.
    fn nested(&mut self, read: impl FnOnce(&mut Self) -> Option<Expression>) -> Option<Expression> {
        self.depth += 1;
        let read = if self.depth > DEPTH_MOST { None } else { read(self) };
        self.depth -= 1;
        read
    }

    fn unary(&mut self) -> Option<Expression> {
        let mut read = self.nested(|reader| match reader.takes("-") {
            true => reader.unary().map(|value| Expression::Negative(value.into())),
            false => reader.operand(),
        })?;
        while self.takes("[") {
            let index = self.expression(0)?;
            read = Expression::Element(read.into(), index.into());
            self.takes("]").then_some(())?;
        }
        Some(read)
    }

    fn operand(&mut self) -> Option<Expression> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        match first {
            Token::Number(number) => Some(Expression::Constant(Value::Number(*number))),
            Token::Text(text) => Some(Expression::Constant(Value::Text((*text).into()))),
            Token::Sign("(") => self.expression(0).filter(|_| self.takes(")")),
            Token::Sign("[") => self.list().map(|list| Expression::List(list, false)),
            Token::Sign(_) => None,
            Token::Name("p") if self.takes("[") => {
                self.list().filter(|list| list.len() == 6).map(|list| Expression::List(list, true))
            }
            Token::Name(name @ ("True" | "False")) => Some(Expression::Constant(Value::Truth(*name == "True"))),
            Token::Name(name) if self.takes("(") => self.call(name).map(Expression::Call),
            Token::Name(name) => Some(Expression::Variable((*name).into())),
        }
    }

    /// Reads the rest of a list.
    fn list(&mut self) -> Option<Vec<Expression>> {
        let mut list = Vec::new();
        while !self.takes("]") {
            (list.is_empty() || self.takes(",")).then_some(())?;
            list.push(self.expression(0)?);
        }
        Some(list)
    }

    /// Reads the arguments of a call, by position or by name.
    fn call(&mut self, name: &str) -> Option<Call> {
        let function = Function::named(name)?;
        let mut arguments = vec![None; function.parameters.len()];
        let mut position = 0;
        while !self.takes(")") {
            (position == 0 || self.takes(",")).then_some(())?;
            let mut index = position;
            if let [Token::Name(name), Token::Sign("="), rest @ ..] = self.rest {
                index = function.parameters.iter().position(|known| known == name)?;
                self.rest = rest;
            }
            let argument = arguments.get_mut(index).filter(|argument| argument.is_none())?;
            *argument = Some(self.expression(0)?);
            position += 1;
        }
        arguments.iter().take(function.required).all(Option::is_some).then_some(Call { function, arguments })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value(text: &str) -> Option<Value> {
        Expression::read(text)?.value(&mut |name| (name == "x").then_some(Value::Number(2.0)), &mut |_, _| None)
    }

    #[test]
    fn operators_bind_as_in_python() {
        for (text, expected) in [
            ("1 + 2 * x - 4 / 2", 3.0),
            ("-(1 + 2) * -x", 6.0),
            ("[1, 2, 3][x] + p[0, 0, 0.5, 0, 0, 0][2]", 3.5),
            ("norm([3e0, 4.0E+0])", 5.0),
            ("norm(-2.5)", 2.5),
            ("sqrt(pow(x, 4))", 4.0),
        ] {
            assert_eq!(value(text), Some(Value::Number(expected)), "{text}");
        }
        for (text, expected) in [
            ("not x < 1 and (x == 2 or False)", true),
            ("x >= 2.5 or not True", false),
            ("norm(pose_sub(p[0,0,1,0,0,0], p[0,0,0.5,0,0,0])) > 0.25", true),
            ("p[1,2,3,0,0,0] == pose_add(p[1,2,1,0,0,0], p[0,0,2,0,0,0])", true),
        ] {
            assert_eq!(value(text), Some(Value::Truth(expected)), "{text}");
        }
    }

    #[test]
    fn what_is_no_expression_is_not_read_and_what_makes_no_sense_has_no_value() {
        for text in ["", "1 +", "(1", "p[1,2]", "dance()", "norm()", "norm(1, 2)", "sleep(u=1)", "1 2", "x = 2", "\"a"]
        {
            assert_eq!(Expression::read(text), None, "{text}");
        }
        assert_eq!(Expression::read(&"(".repeat(10_000)), None);
        for text in ["y", "1 + True", "not 1", "x[0]", "[1][1]", "[1][-1]", "pose_add(1, 2)", "1 and True", "sqrt(-1)"]
        {
            assert!(Expression::read(text).is_some() && value(text).is_none(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn emulator_survives_arbitrary_text(text in ".{0,60}", tokens in "([-+*/(),\\[\\]=<>]|p\\[|x|1|norm\\(|not|and|True| ){0,30}") {
            let _ = (value(&text), value(&tokens));
        }
    }
}
