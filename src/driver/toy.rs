//! A toy array: `ID` is answered with its name, `V` with the outputs, a number each.

use crate::device::{DeviceError, Identity, Problem, SensorArray};
use crate::wire::{Connector, LineExchange};
use std::time::Duration;

/// Longest wait for an answer.
const DEADLINE: Duration = Duration::from_millis(500);

/// A toy array.
pub struct Toy {
    line: LineExchange,
    link: String,
    outputs: usize,
}

impl Toy {
    /// An array of so many outputs; nothing is sent yet.
    pub fn new(connector: Connector, link: String, outputs: usize) -> Self {
        Toy { line: LineExchange::new(connector, DEADLINE, "ID", "TOY"), link, outputs }
    }

    async fn ask(&mut self, doing: &str, question: &str) -> Result<String, DeviceError> {
        self.line.ask(question).await.map_err(|error| failed(doing, Problem::Link(error.to_string())))
    }
}

impl SensorArray for Toy {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let identity = self.ask("identifying it", "ID").await?;
        Ok(Identity { role: "array".to_owned(), identity, link: self.link.clone(), warnings: Vec::new() })
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        let answer = self.ask("reading the outputs", "V").await?;
        let values: Vec<f64> = answer.split_whitespace().map_while(|value| value.parse().ok()).collect();
        if values.len() != outputs.len() {
            self.line.misfit();
            let expected = format!("{} numbers", outputs.len());
            return Err(failed("reading the outputs", Problem::Misfit { answer, expected }));
        }
        outputs.copy_from_slice(&values);
        Ok(())
    }

    fn units(&self) -> usize {
        self.outputs
    }
}

fn failed(doing: &str, problem: Problem) -> DeviceError {
    DeviceError { device: "array (toy)".to_owned(), doing: doing.to_owned(), problem }
}
