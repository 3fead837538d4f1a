use super::errors::Code;
use super::group::{Group, Object};
use super::syntax::{Call, REPLY_MOST, numbers};

/// What a divisor divides: servo ticks a second.
const SERVO_HZ: f64 = 10_000.0;
/// Most values that are gathered at once, all types together.
const VALUES_MOST: usize = 1_000_000;
/// Most types that are gathered together.
const TYPES_MOST: usize = 25;
/// How far a sample may lie in the future by rounding, s.
const ROUNDING_S: f64 = 1e-9;

/// Synchronous gathering: places, speeds and inputs on one clock. The controller looks at them once a millisecond at most;
/// samples between two looks lie on a straight line.
#[derive(Default)]
pub struct Gathering {
    types: Vec<(String, Source)>,
    values: Vec<f64>,
    run: Option<Run>,
}

/// What can be gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source {
    /// `XYZ.X.CurrentPosition`, in counts.
    Position(usize),
    /// `XYZ.X.SetpointPosition`, in counts.
    Setpoint(usize),
    /// `XYZ.X.CurrentVelocity`.
    Velocity(usize),
    /// `GPIO2.ADC1`.
    Input(usize),
}

/// A gathering under way.
struct Run {
    next_s: f64,
    period_s: f64,
    left: usize,
    /// When it was last looked, s, and what was there.
    looked: Option<(f64, Vec<f64>)>,
}

impl Gathering {
    /// `GatheringConfigurationSet(type,...)`.
    pub fn configure(&mut self, call: &mut Call, group: &Group) -> Result<(), Code> {
        self.must_rest()?;
        let mut types = Vec::new();
        while types.is_empty() || !call.is_through() {
            let name = call.text()?;
            types.push((name.to_owned(), source(name, group).ok_or(Code::GATHERED_TYPE)?));
        }
        if types.len() > TYPES_MOST {
            return Err(Code::OUT_OF_RANGE);
        }
        *self = Gathering { types, ..Gathering::default() };
        Ok(())
    }

    /// `GatheringConfigurationGet`.
    pub fn types(&self) -> Result<String, Code> {
        self.must_be_configured()?;
        Ok(self.types.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(";"))
    }

    /// `GatheringRun(number,divisor)`: what was gathered before is gone, the first sample is taken now.
    pub fn run(&mut self, number: i32, divisor: i32, now_s: f64) -> Result<(), Code> {
        self.must_be_configured()?;
        self.must_rest()?;
        let left = usize::try_from(number).unwrap_or(0);
        if left == 0 || divisor < 1 || left.saturating_mul(self.types.len()) > VALUES_MOST {
            return Err(Code::OUT_OF_RANGE);
        }
        self.values.clear();
        self.run = Some(Run { next_s: now_s, period_s: f64::from(divisor) / SERVO_HZ, left, looked: None });
        Ok(())
    }

    /// `GatheringStop`: what was gathered stays.
    pub fn stop(&mut self) -> Result<(), Code> {
        self.run.take().map(|_| ()).ok_or(Code::GATHERING_NOT_STARTED)
    }

    /// `GatheringReset`.
    pub fn reset(&mut self) -> Result<(), Code> {
        self.must_rest()?;
        self.values.clear();
        Ok(())
    }

    /// `GatheringCurrentNumberGet`: how many samples there are, and how many there could be.
    pub fn numbers(&self) -> Result<String, Code> {
        self.must_be_configured()?;
        let types = self.types.len();
        Ok(format!("{},{}", self.values.len() / types, VALUES_MOST / types))
    }

    /// `GatheringDataGet` and `GatheringDataMultipleLinesGet`: samples, each a line, its values parted by `;`.
    pub fn lines(&self, first: i32, number: i32) -> Result<String, Code> {
        if self.values.is_empty() {
            return Err(Code::GATHERING_NOT_STARTED);
        }
        let (first, number) = (usize::try_from(first).ok(), usize::try_from(number).ok());
        let (first, number) = first.zip(number).ok_or(Code::OUT_OF_RANGE)?;
        let samples = self.values.chunks(self.types.len());
        let lines: Vec<String> = samples
            .skip(first)
            .take(number.min(REPLY_MOST))
            .map(|sample| numbers(sample.iter().copied()).replace(',', ";"))
            .collect();
        let text = lines.join("\n");
        // a reply has its end
        let too_long = text.len() > REPLY_MOST - "0,,EndOfAPI".len();
        if lines.is_empty() || lines.len() < number || too_long { Err(Code::OUT_OF_RANGE) } else { Ok(text) }
    }

    /// When the next sample is to be taken, s; infinite: none is.
    pub fn next_s(&self) -> f64 {
        self.run.as_ref().map_or(f64::INFINITY, |run| run.next_s)
    }

    /// Takes the samples that are due by now, if any.
    pub fn look(&mut self, read: impl FnMut(Source) -> f64, now_s: f64) {
        let Some(run) = self.run.as_mut().filter(|run| run.next_s <= now_s + ROUNDING_S) else { return };
        let found: Vec<f64> = self.types.iter().map(|(_, source)| *source).map(read).collect();
        let (before_s, before) = run.looked.take().unwrap_or_else(|| (now_s, found.clone()));
        while run.left > 0 && run.next_s <= now_s + ROUNDING_S {
            let share = if now_s > before_s { (run.next_s - before_s) / (now_s - before_s) } else { 1.0 };
            self.values.extend(before.iter().zip(&found).map(|(before, found)| before + share * (found - before)));
            run.next_s += run.period_s;
            run.left -= 1;
        }
        run.looked = Some((now_s, found));
        self.run.take_if(|run| run.left == 0);
    }

    fn must_rest(&self) -> Result<(), Code> {
        if self.run.is_some() { Err(Code::GATHERING_RUNS) } else { Ok(()) }
    }

    fn must_be_configured(&self) -> Result<(), Code> {
        if self.types.is_empty() { Err(Code::GATHERING_NOT_CONFIGURED) } else { Ok(()) }
    }
}

fn source(name: &str, group: &Group) -> Option<Source> {
    if let Some(input) = super::events::input(name) {
        return Some(Source::Input(input));
    }
    let (object, what) = name.rsplit_once('.')?;
    let Ok(Object::Positioner(index)) = group.object(object) else { return None };
    match what {
        "CurrentPosition" => Some(Source::Position(index)),
        "SetpointPosition" => Some(Source::Setpoint(index)),
        "CurrentVelocity" => Some(Source::Velocity(index)),
        _ => None,
    }
}
