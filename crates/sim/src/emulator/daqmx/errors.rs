//! Errors of the library, as numbers and in words.

/// An error of the library, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DaqmxStatus(pub i32);

impl DaqmxStatus {
    pub(super) const OUT_OF_MEMORY: DaqmxStatus = DaqmxStatus(-50352);
    pub(super) const RESERVED: DaqmxStatus = DaqmxStatus(-50103);
    pub(super) const BAD_VALUE: DaqmxStatus = DaqmxStatus(-200077);
    pub(super) const BAD_TASK: DaqmxStatus = DaqmxStatus(-200088);
    pub(super) const TASK_NAME_TAKEN: DaqmxStatus = DaqmxStatus(-200089);
    pub(super) const NO_SUCH_INPUT: DaqmxStatus = DaqmxStatus(-200170);
    pub(super) const NO_SUCH_DEVICE: DaqmxStatus = DaqmxStatus(-200220);
    pub(super) const BUFFER_TOO_SMALL: DaqmxStatus = DaqmxStatus(-200229);
    pub(super) const OVERRUN: DaqmxStatus = DaqmxStatus(-200279);
    pub(super) const NOT_THERE_IN_TIME: DaqmxStatus = DaqmxStatus(-200284);
    pub(super) const NO_CHANNELS: DaqmxStatus = DaqmxStatus(-200478);
    pub(super) const TASK_RUNS: DaqmxStatus = DaqmxStatus(-200479);

    /// Returns the problem in a sentence; `None` for an unknown number.
    pub(super) fn text(self) -> Option<&'static str> {
        TEXTS.iter().find(|(status, _)| *status == self).map(|(_, text)| *text)
    }

    /// Returns the complete message of the library, with the task concerned.
    pub(super) fn message(self, task: Option<&str>) -> String {
        let text = self.text().unwrap_or("No text is known for this status code.");
        let task = task.map(|name| format!("Task Name: {name}\n\n")).unwrap_or_default();
        format!("{text}\n\n{task}Status Code: {}", self.0)
    }
}

/// Errors of this emulator, in this program's own words.
const TEXTS: [(DaqmxStatus, &str); 12] = [
    (DaqmxStatus::OUT_OF_MEMORY, "There is no memory left for what was asked for."),
    (DaqmxStatus::RESERVED, "The resource is reserved: another task of the device is running."),
    (DaqmxStatus::BAD_VALUE, "The device does not support the value asked for."),
    (DaqmxStatus::BAD_TASK, "The task does not exist, or is not in a state for this."),
    (DaqmxStatus::TASK_NAME_TAKEN, "Another task has this name."),
    (DaqmxStatus::NO_SUCH_INPUT, "The device has no such physical channel."),
    (DaqmxStatus::NO_SUCH_DEVICE, "The device is not known: it is not connected, or has another name."),
    (DaqmxStatus::BUFFER_TOO_SMALL, "The buffer is too small for the samples to be read."),
    (
        DaqmxStatus::OVERRUN,
        "The application did not keep up with the acquisition: samples were overwritten before they were read. A larger \
         buffer, or reading more often, may help.",
    ),
    (DaqmxStatus::NOT_THERE_IN_TIME, "Some or all of the samples asked for were not there in time."),
    (DaqmxStatus::NO_CHANNELS, "The task has no channels."),
    (DaqmxStatus::TASK_RUNS, "The task is running: stop it first."),
];
