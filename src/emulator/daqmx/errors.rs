//! The errors of the library, by number and in words.

/// An error of the library, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status(pub i32);

impl Status {
    pub const OUT_OF_MEMORY: Status = Status(-50352);
    pub const RESERVED: Status = Status(-50103);
    pub const BAD_VALUE: Status = Status(-200077);
    pub const BAD_TASK: Status = Status(-200088);
    pub const TASK_NAME_TAKEN: Status = Status(-200089);
    pub const NO_SUCH_INPUT: Status = Status(-200170);
    pub const NO_SUCH_DEVICE: Status = Status(-200220);
    pub const BUFFER_TOO_SMALL: Status = Status(-200229);
    pub const OVERRUN: Status = Status(-200279);
    pub const NOT_THERE_IN_TIME: Status = Status(-200284);
    pub const NO_CHANNELS: Status = Status(-200478);
    pub const TASK_RUNS: Status = Status(-200479);

    /// What is wrong, in a sentence; none: a number that means nothing here.
    pub fn text(self) -> Option<&'static str> {
        TEXTS.iter().find(|(status, _)| *status == self).map(|(_, text)| *text)
    }

    /// The whole of what the library says, with the task that it concerns.
    pub fn message(self, task: Option<&str>) -> String {
        let text = self.text().unwrap_or("No text is known for this status code.");
        let task = task.map(|name| format!("Task Name: {name}\n\n")).unwrap_or_default();
        format!("{text}\n\n{task}Status Code: {}", self.0)
    }
}

/// The errors met here, in our own words.
const TEXTS: [(Status, &str); 12] = [
    (Status::OUT_OF_MEMORY, "There is no memory left for what was asked for."),
    (Status::RESERVED, "The resource is reserved: another task of the device is running."),
    (Status::BAD_VALUE, "The device does not support the value asked for."),
    (Status::BAD_TASK, "The task does not exist, or is not in a state for this."),
    (Status::TASK_NAME_TAKEN, "Another task has this name."),
    (Status::NO_SUCH_INPUT, "The device has no such physical channel."),
    (Status::NO_SUCH_DEVICE, "The device is not known: it is not connected, or has another name."),
    (Status::BUFFER_TOO_SMALL, "The buffer is too small for the samples to be read."),
    (
        Status::OVERRUN,
        "The application did not keep up with the acquisition: samples were overwritten before they were read. A larger \
         buffer, or reading more often, may help.",
    ),
    (Status::NOT_THERE_IN_TIME, "Some or all of the samples asked for were not there in time."),
    (Status::NO_CHANNELS, "The task has no channels."),
    (Status::TASK_RUNS, "The task is running: stop it first."),
];
