"""OctoPrint's virtual printer on a pseudo-terminal: python3 virtual_printer.py FOLDER ERROR

ERROR is one of its own, such as 1030:resend: what it answers to line 1030. Prints the terminal's name, and each line that asks for another
line again. Of OctoPrint only this one file is loaded, with stand-ins for what it imports. Its moves take a tenth of their time."""

import ast
import functools
import importlib.util
import logging
import os
import sys
import threading
import tty
import types

FOLDER = sys.argv[1]
STEPS_PER_MM = 100
CHANGED = {
    "firmwareName": "Marlin 2.1.2 (virtual)",
    "sendBusy": True,
    "simulated_errors": sys.argv[2:],
    "m115ReportCapabilities": False,
}


class Anything:
    """Stands for what isn't used here."""

    def __init__(self, *_, **__):
        pass

    def __getattr__(self, _):
        return Anything()

    def __call__(self, *_, **__):
        return Anything()

    def __iter__(self):
        return iter(())


def stand_in(name, **members):
    module = types.ModuleType(name)
    module.__dict__.update(members)
    module.__getattr__ = lambda _: Anything
    sys.modules[name] = module


def loaded():
    """The virtual printer's class, and its default settings."""
    root = importlib.util.find_spec("octoprint").submodule_search_locations[0]
    folder = os.path.join(root, "plugins", "virtual_printer")
    to_bytes = lambda text, *_, **__: text if isinstance(text, bytes) else text.encode()
    to_unicode = lambda text, *_, **__: text.decode() if isinstance(text, bytes) else text
    stand_in("octoprint")
    stand_in("octoprint.plugin", plugin_manager=Anything())
    stand_in("octoprint.util", to_bytes=to_bytes, to_unicode=to_unicode)
    stand_in("octoprint.util.files")
    spec = importlib.util.spec_from_file_location("virtual", os.path.join(folder, "virtual.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    def position(self):
        # its own count truncates: -4.6 mm times 100 is -459.99
        x, y, z = self._lastX, self._lastY, self._lastZ
        counts = [round(mm * STEPS_PER_MM) for mm in (x, y, z)]
        return f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:{counts[0]} Y:{counts[1]} Z:{counts[2]}"

    module.VirtualPrinter._generatePositionOutput = position
    return module.VirtualPrinter, settings_of(os.path.join(folder, "__init__.py"))


def settings_of(path):
    """The dictionary that `get_settings_defaults` returns: a literal in the plugin's text."""
    for node in ast.walk(ast.parse(open(path).read())):
        if isinstance(node, ast.FunctionDef) and node.name == "get_settings_defaults":
            return ast.literal_eval(next(each for each in node.body if isinstance(each, ast.Return)).value)


class Settings:
    def __init__(self, values):
        self.values = {**values, **CHANGED}

    def get(self, path, **_):
        return self.values.get(path[0]) if path else self.values

    get_int = get_float = get_boolean = get

    def global_get_basefolder(self, _):
        return FOLDER


def main():
    printer_class, defaults = loaded()
    printer = printer_class(Settings(defaults), Anything(), FOLDER, seriallog_handler=logging.NullHandler(), read_timeout=0.05)
    steps = f"N1 M92 X{STEPS_PER_MM} Y{STEPS_PER_MM} Z{STEPS_PER_MM}".encode()
    printer.write(steps + b"*%d\n" % functools.reduce(lambda sum, byte: sum ^ byte, steps))
    ours, theirs = os.openpty()
    tty.setraw(theirs)

    def receive():
        inbox = b""
        while True:
            inbox += os.read(ours, 4096)
            while b"\n" in inbox:
                line, inbox = inbox.split(b"\n", 1)
                printer.write(line + b"\n")

    def send():
        while True:
            line = printer.readline()
            if line:
                os.write(ours, line.rstrip() + b"\n")
                if line.startswith(b"Resend"):
                    print(line.decode().strip(), flush=True)

    threading.Thread(target=receive, daemon=True).start()
    threading.Thread(target=send, daemon=True).start()
    print(f"printer at {os.ttyname(theirs)}", flush=True)
    threading.Event().wait()


main()
