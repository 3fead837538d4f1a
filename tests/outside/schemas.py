"""Validates texts against a JSON Schema with another program's validator.

    schemas.py SCHEMA TEXT...

Prints for each text a line: its name, and `accepted`, `refused` or `no TOML`.
"""

import json
import sys
import tomllib
from pathlib import Path

import jsonschema

schema = json.loads(Path(sys.argv[1]).read_text())
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
for name in sys.argv[2:]:
    try:
        text = tomllib.loads(Path(name).read_text())
    except tomllib.TOMLDecodeError:
        print(Path(name).name, "no TOML")
        continue
    print(Path(name).name, "accepted" if validator.is_valid(text) else "refused")
