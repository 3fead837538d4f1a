"""Reads a Digital Calibration Certificate with Python's own XML parser, and prints its results as JSON: name, value, unit, expanded
uncertainty or interval, in the document's order."""

import json
import sys
import xml.etree.ElementTree as tree

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


def text(element, path):
    found = element.find(path, NAMES)
    return None if found is None else found.text


def number(element, path):
    found = text(element, path)
    return None if found is None else float(found)


root = tree.parse(sys.argv[1]).getroot()
results = [
    {
        "name": text(quantity, "dcc:name/dcc:content"),
        "value": number(quantity, "si:real/si:value"),
        "unit": text(quantity, "si:real/si:unit"),
        "expanded": number(quantity, "si:real/si:expandedUnc/si:uncertainty"),
        "k": number(quantity, "si:real/si:expandedUnc/si:coverageFactor"),
        "least": number(quantity, "si:real/si:coverageInterval/si:intervalMin"),
        "most": number(quantity, "si:real/si:coverageInterval/si:intervalMax"),
    }
    for quantity in root.findall(".//dcc:results//dcc:quantity", NAMES)
]
print(json.dumps({
    "version": root.get("schemaVersion"),
    "identifier": text(root, ".//dcc:coreData/dcc:uniqueIdentifier"),
    "serial": text(root, ".//dcc:item/dcc:identifications/dcc:identification/dcc:value"),
    "conformity": text(root, ".//dcc:conformity"),
    "results": results,
}))
