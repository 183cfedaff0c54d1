#!/usr/bin/python3
"""The files for PLCs as their users' programs read them: XML, CSV, and source code that says what Finsight.st says.

usage: plc_files_test.py [unittest arguments]
"""
import csv
import json
import re
import shutil
import subprocess
import unittest
import xml.etree.ElementTree as ElementTree
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "hostgen" / "plc"
ST_WORDS = {"IF", "THEN", "ELSE", "ELSIF", "END_IF", "AND", "OR", "NOT", "COP", "TONR", "PRE", "TimerEnable", "DN"}


def table():
    with open(FOLDER / "registers.csv", newline="") as file:
        return [row for row in csv.DictReader(file) if not row["name"].startswith("reserved")]


def body_of(text, block):
    """What stands between the last END_VAR (or BEGIN) of a function block and its end, as words."""
    unit = re.search(rf'FUNCTION_BLOCK "?{block}"?\n(.*?)END_FUNCTION_BLOCK', text, re.S).group(1)
    return " ".join(re.split(r"END_VAR\n(?:BEGIN\n)?", unit)[-1].split())


def is_written_alone(register):
    """A tag is written by itself; the device takes command and number, and the numbers of gravity, only together."""
    together = register["name"] in ("command", "command_sequence") or register["name"].startswith("gravity_")
    return register["access"] == "read/write" and not together


class Rockwell(unittest.TestCase):
    def setUp(self):
        self.root = ElementTree.parse(FOLDER / "Finsight.L5X").getroot()
        self.instruction = self.root.find("./Controller/AddOnInstructionDefinitions/AddOnInstructionDefinition")
        self.parameters = {p.get("Name"): p for p in self.instruction.find("Parameters")}
        self.locals = {t.get("Name"): t for t in self.instruction.find("LocalTags")}

    def test_the_export_names_its_target(self):
        self.assertEqual(self.root.tag, "RSLogix5000Content")
        self.assertEqual(self.root.get("TargetType"), "AddOnInstructionDefinition")
        self.assertEqual(self.root.get("TargetName"), self.instruction.get("Name"))
        self.assertEqual(self.instruction.get("Use"), "Target")

    def test_every_measurement_is_a_parameter(self):
        variables = set(re.findall(r"^  (\w+) : \w+;", (FOLDER / "Finsight.st").read_text().split("FB_Finsight\n")[1]
                                   .split("VAR_OUTPUT")[1].split("END_VAR")[0], re.M))
        self.assertGreater(len(variables), 80)
        self.assertEqual(variables - set(self.parameters), set())

    def test_names_and_types_are_what_a_controller_takes(self):
        names = [*self.parameters, *self.locals]
        self.assertEqual(len({name.lower() for name in names}), len(names), "names differ by more than their case")
        for name in names:
            self.assertRegex(name, r"^[A-Za-z]\w{0,39}$")
            self.assertNotRegex(name, "__|_$")
        for name, parameter in self.parameters.items():
            self.assertIn(parameter.get("Usage"), ("Input", "Output", "InOut"), name)
            self.assertIn(parameter.get("DataType"), ("BOOL", "INT", "DINT", "REAL"), name)
            if parameter.get("Dimensions"):
                self.assertEqual(parameter.get("Usage"), "InOut", name)
            elif parameter.get("Usage") != "InOut" and not name.startswith("Enable"):
                value = parameter.find("./DefaultData[@Format='Decorated']/DataValue")
                self.assertEqual(value.get("DataType"), parameter.get("DataType"), name)

    def test_the_logic_uses_declared_names_and_every_output_is_assigned(self):
        lines = self.instruction.findall("./Routines/Routine[@Type='ST']/STContent/Line")
        self.assertEqual([int(line.get("Number")) for line in lines], list(range(len(lines))))
        code = "\n".join(re.sub("//.*", "", line.text or "") for line in lines)
        used = set(re.findall(r"(?<![#\w])[A-Za-z]\w*", re.sub(r"16#[0-9A-Fa-f_]+", "0", code)))
        self.assertEqual(used - set(self.parameters) - set(self.locals) - ST_WORDS, set())
        self.assertEqual(len(re.findall(r"\bIF\b", code)), code.count("END_IF;"))
        for name, parameter in self.parameters.items():
            if parameter.get("Usage") == "Output" and name != "EnableOut":
                self.assertRegex(code, rf"\b{name} := ")


class Siemens(unittest.TestCase):
    def test_its_blocks_do_what_those_of_structured_text_do(self):
        st, scl = (FOLDER / "Finsight.st").read_text(), (FOLDER / "Finsight.scl").read_text()
        for ours, theirs in (("FB_Finsight", "Finsight_FB"), ("FB_FinsightCommand", "Finsight_Command")):
            body = body_of(scl, theirs).replace("#values.", "").replace("#", "")
            body = re.sub(r"SHL\(IN := (.*?), N := 16\)", r"SHL(\1, 16)", body)
            body = body.replace("DWORD_TO_REAL(", "FC_FinsightReal(")
            self.assertEqual(body, body_of(st, ours).replace("#", ""))


class NodeRed(unittest.TestCase):
    def setUp(self):
        if not shutil.which("node"):
            self.skipTest("node is not installed")
        self.nodes = {node["id"]: node for node in json.loads((FOLDER / "Finsight.node-red.json").read_text())}

    def run_functions(self, script):
        """What the script's `out` holds at its end; call(id, payload) runs a function node with one flow memory."""
        functions = {name: node["func"] for name, node in self.nodes.items() if node["type"] == "function"}
        program = f"""const functions = {json.dumps(functions)}, memory = {{}}, out = [];
const flow = {{get: key => memory[key], set: (key, value) => {{ memory[key] = value; }}}};
const call = (id, payload) => {{ const msg = new Function('msg', 'flow', functions[id])({{payload}}, flow);
  return msg && msg.payload; }};
{script}
console.log(JSON.stringify(out));"""
        return json.loads(subprocess.run(["node", "-e", program], capture_output=True, text=True, check=True).stdout)

    def test_commands_have_new_numbers_and_their_own_results(self):
        first, second, results = self.run_functions("""
const a = call('finsight-number', 9), b = call('finsight-number', 9);
out.push(a, b, [[1, 9, 0], [b[1], 9, 4], [b[1], 9, 1], [b[1], 9, 1]].map(own => call('finsight-result', own)));""")
        self.assertEqual((first[0], second[0]), (9, 9))
        self.assertNotEqual(first[1], second[1])
        self.assertTrue(20000 <= second[1] <= 29999)
        self.assertEqual(results, [None, None, {"command": 9, "result": 1}, None])

    def test_every_wire_ends_at_a_node(self):
        for node in self.nodes.values():
            for wire in sum(node.get("wires", []), []):
                self.assertIn(wire, self.nodes)


class TagLists(unittest.TestCase):
    def rows(self, name):
        with open(FOLDER / name, newline="") as file:
            return list(csv.DictReader(file))

    def check_invalid(self, register, description, rows):
        """Beside a tag whose invalid value is scaled stands one that is not, and the description says so."""
        if not register["invalid"] or register["scale"] == "1":
            return
        raw = rows.pop(register["name"] + "_raw")
        self.assertIn(raw["Data Type"] if "Data Type" in raw else raw["DataType"], ("Short", "Word", "1", "2"))
        self.assertEqual(raw.get("Scaling", ""), "")
        self.assertEqual(raw.get("ScaleMode", "0"), "0")
        scaled = float(register["invalid"]) * float(register["scale"])
        self.assertIn(f"{scaled:g} is no measurement", description)
        self.assertIn(f"{register['name']}_raw is {register['invalid']}", description)

    def test_kepware_has_every_register_and_bit(self):
        rows = {row["Tag Name"]: row for row in self.rows("Finsight.kepware.csv")}
        for register in table():
            row = rows.pop(register["name"])
            self.assertEqual(row["Address"].split(".")[0], str(400001 + int(register["address"])))
            self.assertEqual(row["Client Access"], "R/W" if is_written_alone(register) else "RO")
            if register["scale"] != "1":
                self.assertEqual(float(row["Scaled High"]) / float(row["Raw High"]), float(register["scale"]))
            self.check_invalid(register, row["Description"], rows)
        self.assertEqual({row["Data Type"] for row in rows.values()}, {"Boolean"})

    def test_ignition_has_every_register_and_bit(self):
        rows = {row["Name"]: row for row in self.rows("Finsight.ignition.csv")}
        for register in table():
            row = rows.pop(register["name"])
            item = re.fullmatch(r"\[Finsight\](HR[USIF]*)(\d+)(?::32)?", row["OPCItemPath"])
            self.check_invalid(register, row["Documentation"], rows)
            self.assertEqual(int(item[2]), int(register["address"]) + 1)
            self.assertEqual(item[1], {"uint16": "HRUS", "int16": "HR", "uint32": "HRUI", "float32": "HRF",
                                       "text32": "HRS"}[register["type"]])
        self.assertEqual({row["DataType"] for row in rows.values()}, {"6"})

    def test_references_are_counted_from_40001(self):
        for register in table():
            self.assertEqual(int(register["reference"]), 40001 + int(register["address"]))


if __name__ == "__main__":
    unittest.main(verbosity=2)
