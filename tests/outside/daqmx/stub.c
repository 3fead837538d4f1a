/* Stands for NI's library: the functions of NIDAQmx.h that src/wire/daqmx calls, and those that nidaqmx-python's Task calls
 * too, with that header's parameters and codes.
 *
 * It has two devices. Sample n of input aiK reads K + n/1000 V: both the input and the sample can be told from a
 * voltage. Samples come on the real clock. "Dev1" keeps all that its buffer holds; of "Lost1" all is overwritten by the
 * time it is read. Any other device is unknown. -DLACKS_STOP leaves one function out. */

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef void *TaskHandle;

enum { CHANNELS_MOST = 64 };
enum {
    TOO_FEW_SAMPLES = -200284,
    OVERRUN = -200279,
    UNKNOWN_DEVICE = -200220,
    BAD_TASK = -200088,
    BAD_VALUE = -200077,
    BUFFER_TOO_SMALL = -200228,
};
enum { DEFAULT = -1, RSE = 10083, NRSE = 10078, DIFF = 10106, PSEUDO_DIFF = 12529 };
enum { VOLTS = 10348, RISING = 10280, CONTINUOUS = 10123, BY_SCAN = 1, ALL_THERE = -1 };

typedef struct {
    char device[32];
    int channels, inputs[CHANNELS_MOST], loses, runs;
    double rate_hz;
    uint64_t room, taken;
    struct timespec begun;
} Task;

/* The last error of this thread, as the real library keeps it. */
static _Thread_local char told[512];

static int32_t fail(int32_t code, const char *text) {
    snprintf(told, sizeof told, "%s\n\nStatus Code: %d", text, code);
    return code;
}

static double elapsed_s(const Task *task) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)(now.tv_sec - task->begun.tv_sec) + 1e-9 * (double)(now.tv_nsec - task->begun.tv_nsec);
}

int32_t DAQmxCreateTask(const char *name, TaskHandle *handle) {
    if (!name || !handle)
        return fail(BAD_VALUE, "Requested value is not a supported value for this property.");
    *handle = calloc(1, sizeof(Task));
    return 0;
}

int32_t DAQmxCreateAIVoltageChan(TaskHandle handle, const char *physical, const char *name, int32_t terminal,
                                 double least, double most, int32_t units, const char *scale) {
    Task *task = handle;
    int known_terminal = terminal == DEFAULT || terminal == RSE || terminal == NRSE || terminal == DIFF ||
                         terminal == PSEUDO_DIFF;
    (void)name;
    if (!task)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    if (!known_terminal || units != VOLTS || (scale && *scale) || !(least < most) || most > 10.0 || least < -10.0)
        return fail(BAD_VALUE, "Requested value is not a supported value for this property.");
    char device[32];
    int first, last, fields = sscanf(physical, "%31[^/]/ai%d:%d", device, &first, &last);
    if (fields == 2)
        last = first;
    if (fields < 2 || first < 0 || last < first || task->channels + last - first + 1 > CHANNELS_MOST)
        return fail(BAD_VALUE, "Physical channel does not exist.");
    if (strcmp(device, "Dev1") && strcmp(device, "Lost1")) {
        char text[128];
        snprintf(text, sizeof text, "Device identifier is invalid.\n\nDevice Specified: %s", device);
        return fail(UNKNOWN_DEVICE, text);
    }
    task->loses |= !strcmp(device, "Lost1");
    memcpy(task->device, device, sizeof device);
    for (int input = first; input <= last; input++)
        task->inputs[task->channels++] = input;
    return 0;
}

int32_t DAQmxCfgSampClkTiming(TaskHandle handle, const char *source, double rate, int32_t edge, int32_t mode,
                              uint64_t samples) {
    Task *task = handle;
    if (!task)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    if ((source && *source) || edge != RISING || mode != CONTINUOUS || !samples || !(rate > 0.0) ||
        rate * task->channels > 500e3)
        return fail(BAD_VALUE, "Requested value is not a supported value for this property.");
    task->rate_hz = rate;
    task->room = samples;
    return 0;
}

int32_t DAQmxStartTask(TaskHandle handle) {
    Task *task = handle;
    if (!task || !task->channels || task->rate_hz <= 0.0)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    clock_gettime(CLOCK_MONOTONIC, &task->begun);
    task->taken = 0;
    task->runs = 1;
    return 0;
}

#ifndef LACKS_STOP
int32_t DAQmxStopTask(TaskHandle handle) {
    Task *task = handle;
    if (!task)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    task->runs = 0;
    return 0;
}
#endif

int32_t DAQmxClearTask(TaskHandle handle) {
    if (!handle)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    free(handle);
    return 0;
}

int32_t DAQmxReadAnalogF64(TaskHandle handle, int32_t samples, double timeout, uint32_t fill, double *buffer,
                           uint32_t length, int32_t *read, uint32_t *reserved) {
    Task *task = handle;
    if (!task || !task->runs || reserved)
        return fail(BAD_TASK, "Task specified is invalid or does not exist.");
    *read = 0;
    uint64_t there;
    do
        there = (uint64_t)(elapsed_s(task) * task->rate_hz) - task->taken;
    while (samples != ALL_THERE && there < (uint64_t)samples && elapsed_s(task) < timeout);
    if (there > task->room || (task->loses && there > 0))
        return fail(OVERRUN, "The application is not able to keep up with the hardware acquisition.");
    if (samples != ALL_THERE && there < (uint64_t)samples)
        return fail(TOO_FEW_SAMPLES, "Some or all of the samples requested have not yet been acquired.");
    uint64_t count = samples == ALL_THERE ? there : (uint64_t)samples;
    if (count > length / (uint32_t)task->channels) {
        if (samples != ALL_THERE)
            return fail(BUFFER_TOO_SMALL, "Buffer is too small to fit read data.");
        count = length / (uint32_t)task->channels;
    }
    for (uint64_t n = 0; n < count; n++)
        for (int channel = 0; channel < task->channels; channel++) {
            uint64_t of_scan = n * (uint64_t)task->channels + (uint64_t)channel;
            uint64_t of_channel = (uint64_t)channel * count + n;
            uint64_t at = fill == BY_SCAN ? of_scan : of_channel;
            buffer[at] = task->inputs[channel] + 1e-3 * (double)(task->taken + n);
        }
    task->taken += count;
    *read = (int32_t)count;
    return 0;
}

/* Not called by us: nidaqmx-python asks for the version first, one number an attribute. */
int32_t DAQmxGetSystemInfoAttribute(int32_t attribute, uint32_t *value) {
    enum { MAJOR_VERSION = 0x1272 };
    *value = attribute == MAJOR_VERSION ? 25 : 0;
    return 0;
}

/* Attributes that nidaqmx-python's Task asks for (numbers from NIDAQmx.h). A text is asked for twice: for its size, then for itself. */
enum { TASK_NAME = 0x1276, TASK_CHANNELS = 0x1273, TASK_CHANNEL_COUNT = 0x2181 };
enum { READ_CHANNELS = 0x1823, READ_CHANNEL_COUNT = 0x217B, READ_AUTO_START = 0x1826 };
enum { CHANNEL_TYPE = 0x187F, AI_MEASUREMENT_TYPE = 0x0695, ANALOG_INPUT = 10100, VOLTAGE = 10322 };

static int32_t text_of(const char *text, va_list asked) {
    char *buffer = va_arg(asked, char *);
    uint32_t length = va_arg(asked, uint32_t);
    if (!buffer || !length)
        return (int32_t)strlen(text) + 1;
    snprintf(buffer, length, "%s", text);
    return 0;
}

static int32_t names_of(const Task *task, va_list asked) {
    char names[CHANNELS_MOST * 48] = "";
    for (int channel = 0; channel < task->channels; channel++) {
        size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s%s/ai%d", used ? ", " : "", task->device, task->inputs[channel]);
    }
    return text_of(names, asked);
}

static int32_t number_of(uint32_t number, va_list asked) {
    *va_arg(asked, uint32_t *) = number;
    return 0;
}

static int32_t unknown_attribute(void) {
    return fail(BAD_VALUE, "Specified property is not supported.");
}

int32_t DAQmxGetTaskAttribute(TaskHandle handle, int32_t attribute, ...) {
    va_list asked;
    va_start(asked, attribute);
    int32_t answer = attribute == TASK_NAME            ? text_of("_unnamedTask<0>", asked)
                     : attribute == TASK_CHANNELS      ? names_of(handle, asked)
                     : attribute == TASK_CHANNEL_COUNT ? number_of((uint32_t)((Task *)handle)->channels, asked)
                                                       : unknown_attribute();
    va_end(asked);
    return answer;
}

int32_t DAQmxGetReadAttribute(TaskHandle handle, int32_t attribute, ...) {
    va_list asked;
    va_start(asked, attribute);
    int32_t answer = attribute == READ_CHANNELS        ? names_of(handle, asked)
                     : attribute == READ_CHANNEL_COUNT ? number_of((uint32_t)((Task *)handle)->channels, asked)
                     : attribute == READ_AUTO_START    ? number_of(1, asked)
                                                       : unknown_attribute();
    va_end(asked);
    return answer;
}

int32_t DAQmxGetChanAttribute(TaskHandle handle, const char *channel, int32_t attribute, ...) {
    va_list asked;
    (void)handle, (void)channel;
    va_start(asked, attribute);
    int32_t answer = attribute == CHANNEL_TYPE          ? number_of(ANALOG_INPUT, asked)
                     : attribute == AI_MEASUREMENT_TYPE ? number_of(VOLTAGE, asked)
                                                        : unknown_attribute();
    va_end(asked);
    return answer;
}

int32_t DAQmxGetExtendedErrorInfo(char *buffer, uint32_t length) {
    snprintf(buffer, length, "%s", told);
    return 0;
}

int32_t DAQmxGetErrorString(int32_t code, char *buffer, uint32_t length) {
    snprintf(buffer, length, "Status code %d", code);
    return 0;
}
