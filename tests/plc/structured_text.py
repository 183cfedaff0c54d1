"""Checks and runs IEC 61131-3 Structured Text: the part of the standard that Finsight.st uses, and nothing beside it.

It stands for a compiler, because neither Debian nor npm has one. What it refuses a compiler refuses too: undeclared
names, operands and assignments of the wrong type, calls of unknown functions, anonymous types where a named one is
declared, statements outside the grammar. Types are those of the standard without implicit conversion, except that a
literal takes the type that is expected. Time passes only when Machine.now_ms is set.
"""
import re

TOKEN = re.compile(r"""\s+|\(\*.*?\*\)|(?P<time>T\#\d+(?:ms|s))|(?P<typed>[A-Z]+\#(?:16\#[0-9A-F]+|\d+))|(?P<hex>16\#[0-9A-F]+)
 |(?P<real>\d+\.\d+)|(?P<int>\d+)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<op>:=|<>|<=|>=|\.\.|[-+*/=<>()\[\]:;,.])""",
                   re.X | re.S)
WIDTH = {"WORD": 16, "DWORD": 32, "UINT": 16, "UDINT": 32, "INT": 16}
BITS, NUMBERS = ("BOOL", "WORD", "DWORD"), ("INT", "UINT", "UDINT", "REAL", "TIME")
WORDS = {"IF", "THEN", "ELSE", "ELSIF", "END_IF", "WHILE", "DO", "END_WHILE", "AND", "OR", "NOT", "TRUE", "FALSE", "VAR",
         "VAR_INPUT", "VAR_IN_OUT", "VAR_OUTPUT", "END_VAR", "FUNCTION", "END_FUNCTION", "FUNCTION_BLOCK", "END_FUNCTION_BLOCK", "TYPE",
         "END_TYPE", "ARRAY", "OF"}


class Refused(Exception):
    """Not standard Structured Text."""


def tokens_of(text):
    at, found = 0, []
    while at < len(text):
        match = TOKEN.match(text, at)
        if not match:
            raise Refused(f"line {text.count(chr(10), 0, at) + 1}: '{text[at:at + 20]}'")
        if match.lastgroup:
            found.append((match.lastgroup, match.group(), text.count("\n", 0, at) + 1))
        at = match.end()
    return found + [("end", "", 0)]


def wrapped(kind, value):
    if kind == "INT":
        return (int(value) + 0x8000) % 0x10000 - 0x8000
    return int(value) % (1 << WIDTH[kind]) if kind in WIDTH else value


CONVERSIONS = {f"{a}_TO_{b}": (a, b) for a in ("INT", "UINT", "UDINT", "WORD", "DWORD", "REAL")
               for b in ("INT", "UINT", "UDINT", "WORD", "DWORD", "REAL") if a != b and {a, b} != {"WORD", "REAL"}
               and {a, b} != {"DWORD", "REAL"}}


class TON:
    """The standard's on-delay timer."""
    FIELDS = {"Q": "BOOL", "ET": "TIME"}
    INPUTS = {"IN": "BOOL", "PT": "TIME"}

    def __init__(self, machine):
        self.machine, self.since, self.values = machine, None, {"Q": False, "ET": 0}

    def call(self, values):
        if not values["IN"]:
            self.since, self.values = None, {"Q": False, "ET": 0}
            return
        if self.since is None:
            self.since = self.machine.now_ms
        elapsed = self.machine.now_ms - self.since
        self.values = {"Q": elapsed >= values["PT"], "ET": min(elapsed, values["PT"])}


class Machine:
    """The units of a source text; block(name) makes an instance of a function block."""

    def __init__(self, text):
        self.tokens, self.at, self.now_ms = tokens_of(text), 0, 0
        self.types, self.functions, self.blocks = {}, {}, {}
        while self.kind != "end":
            if self.take_word("TYPE"):
                self.parse_types()
            elif self.take_word("FUNCTION"):
                self.parse_unit("END_FUNCTION", self.functions)
            elif self.take_word("FUNCTION_BLOCK"):
                self.parse_unit("END_FUNCTION_BLOCK", self.blocks)
            else:
                self.refuse("TYPE, FUNCTION or FUNCTION_BLOCK")

    def block(self, name, shared=None):
        return Instance(self, self.blocks[name], shared)

    # The parser: one token ahead.
    @property
    def kind(self):
        return self.tokens[self.at][0]

    @property
    def text(self):
        return self.tokens[self.at][1]

    def refuse(self, expected):
        raise Refused(f"line {self.tokens[self.at][2]}: found '{self.text}', expected {expected}")

    def take(self, text):
        if self.text != text:
            self.refuse(f"'{text}'")
        self.at += 1

    def take_word(self, text):
        if self.text == text:
            self.at += 1
            return True
        return False

    def take_kind(self, kind):
        if self.kind != kind or self.text in WORDS:
            self.refuse(kind)
        self.at += 1
        return self.tokens[self.at - 1][1]

    def parse_types(self):
        while not self.take_word("END_TYPE"):
            name = self.take_kind("name")
            for word in (":", "ARRAY", "["):
                self.take(word)
            low = int(self.take_kind("int"))
            self.take("..")
            high = int(self.take_kind("int"))
            for word in ("]", "OF"):
                self.take(word)
            self.types[name] = ("ARRAY", low, high, self.take_kind("name"))
            self.take(";")

    def parse_unit(self, end, units):
        name = self.take_kind("name")
        unit = {"name": name, "variables": {}, "inputs": [], "shared": [], "outputs": [], "initial": {}}
        if end == "END_FUNCTION":
            self.take(":")
            unit["variables"][name] = self.take_kind("name")
        while self.text in ("VAR", "VAR_INPUT", "VAR_IN_OUT", "VAR_OUTPUT"):
            section = self.text
            self.at += 1
            while not self.take_word("END_VAR"):
                variable = self.take_kind("name")
                if variable in unit["variables"]:
                    self.refuse(f"'{variable}' once")
                self.take(":")
                kind = self.take_kind("name")
                if kind not in BITS + NUMBERS and kind not in self.types and kind != "TON":
                    self.at -= 1
                    self.refuse("a type of the standard or a declared one")
                unit["variables"][variable] = kind
                if self.take_word(":="):
                    unit["initial"][variable] = self.literal(kind)
                self.take(";")
                if section != "VAR":
                    lists = {"VAR_INPUT": "inputs", "VAR_IN_OUT": "shared", "VAR_OUTPUT": "outputs"}
                    unit[lists[section]].append(variable)
        self.scope = unit["variables"]
        unit["body"] = self.statements((end,))
        self.take(end)
        units[name] = unit

    def literal(self, kind):
        value_kind, run = self.primary(kind)
        self.require(value_kind, kind)
        return run(None)

    def statements(self, ends):
        body = []
        while self.text not in ends:
            body.append(self.statement())
        return body

    def statement(self):
        if self.take_word("IF"):
            branches = [self.branch()]
            while self.take_word("ELSIF"):
                branches.append(self.branch())
            otherwise = self.statements(("END_IF",)) if self.take_word("ELSE") else []
            self.take("END_IF")
            self.take(";")

            def run_if(scope):
                for condition, body in branches:
                    if condition(scope):
                        return execute(body, scope)
                return execute(otherwise, scope)
            return run_if
        if self.take_word("WHILE"):
            condition = self.typed_expression("BOOL")
            self.take("DO")
            body = self.statements(("END_WHILE",))
            self.take("END_WHILE")
            self.take(";")

            def run_while(scope):
                while condition(scope):
                    execute(body, scope)
            return run_while
        return self.assignment_or_call()

    def branch(self):
        condition = self.typed_expression("BOOL")
        self.take("THEN")
        return condition, self.statements(("ELSIF", "ELSE", "END_IF"))

    def assignment_or_call(self):
        name = self.take_kind("name")
        if name not in self.scope:
            self.at -= 1
            self.refuse("a declared variable")
        kind = self.scope[name]
        if kind == "TON":
            inputs = self.arguments(TON.INPUTS)
            self.take(";")
            return lambda scope: scope[name].call({key: run(scope) for key, run in inputs.items()})
        index = None
        if self.take_word("["):
            index, low = int(self.take_kind("int")), self.types[kind][1]
            if not low <= index <= self.types[kind][2]:
                self.refuse("an index in the array")
            kind = self.types[kind][3]
            self.take("]")
        self.take(":=")
        run = self.typed_expression(kind)
        self.take(";")

        def assign(scope):
            if index is None:
                scope[name] = wrapped(kind, run(scope))
            else:
                scope[name][index - low] = wrapped(kind, run(scope))
        return assign

    def arguments(self, inputs):
        self.take("(")
        found = {}
        while True:
            name = self.take_kind("name")
            if name not in inputs:
                self.refuse("an input of it")
            self.take(":=")
            found[name] = self.typed_expression(inputs[name])
            if not self.take_word(","):
                break
        self.take(")")
        return found

    def require(self, found, expected):
        if found != expected:
            self.refuse(f"{expected} before it, found {found}")

    def typed_expression(self, kind):
        found, run = self.disjunction(kind)
        self.require(found, kind)
        return run

    # Expressions, weakest operator first. `wanted`: the type that literals take.
    def disjunction(self, wanted):
        return self.chain(("OR",), self.conjunction, wanted, BITS)

    def conjunction(self, wanted):
        return self.chain(("AND",), self.comparison, wanted, BITS)

    def chain(self, operators, operand, wanted, kinds):
        kind, run = operand(wanted)
        while self.text in operators:
            operator = self.text
            self.at += 1
            right_kind, right = operand(kind)
            self.require(right_kind, kind)
            if kind not in kinds:
                self.refuse(f"operands of {operator}, found {kind}")
            run = operation(operator, kind, run, right)
        return kind, run

    def comparison(self, wanted):
        kind, run = self.sum(wanted)
        if self.text in ("=", "<>", "<", ">", "<=", ">="):
            operator = self.text
            self.at += 1
            right_kind, right = self.sum(kind)
            self.require(right_kind, kind)
            return "BOOL", operation(operator, kind, run, right)
        return kind, run

    def sum(self, wanted):
        return self.chain(("+", "-"), self.term, wanted, NUMBERS)

    def term(self, wanted):
        return self.chain(("*", "/"), self.unary, wanted, ("INT", "UINT", "UDINT", "REAL"))

    def unary(self, wanted):
        if self.take_word("NOT"):
            kind, run = self.unary(wanted)
            if kind != "BOOL":
                self.refuse("BOOL behind NOT")
            return kind, lambda scope: not run(scope)
        if self.take_word("-"):
            kind, run = self.unary(wanted)
            if kind not in ("INT", "REAL"):
                self.refuse("a signed number behind -")
            return kind, lambda scope: -run(scope)
        return self.primary(wanted)

    def primary(self, wanted):
        kind, text = self.kind, self.text
        if self.take_word("("):
            found = self.disjunction(wanted)
            self.take(")")
            return found
        self.at += 1
        if text in ("TRUE", "FALSE"):
            return "BOOL", lambda _: text == "TRUE"
        if kind == "time":
            number = int(re.search(r"\d+", text).group()) * (1 if text.endswith("ms") else 1000)
            return "TIME", lambda _: number
        if kind == "typed":
            name, _, digits = text.partition("#")
            number = int(digits[3:], 16) if digits.startswith("16#") else int(digits)
            return name, lambda _: number
        if kind == "real":
            return "REAL", lambda _: float(text)
        if kind in ("int", "hex"):
            if wanted not in ("INT", "UINT", "UDINT"):
                self.refuse(f"a literal of type {wanted}")
            return wanted, lambda _: int(text[3:], 16) if kind == "hex" else int(text)
        if kind == "name" and self.text == "(":
            return self.function(text)
        if kind == "name" and text in self.scope:
            return self.variable(text)
        self.at -= 1
        return self.refuse("a value")

    def variable(self, name):
        kind = self.scope[name]
        if self.take_word("."):
            field = self.take_kind("name")
            return TON.FIELDS[field], lambda scope: scope[name].values[field]
        if kind in self.types:
            self.take("[")
            index, (_, low, high, element) = int(self.take_kind("int")), self.types[kind]
            self.take("]")
            if not low <= index <= high:
                self.refuse("an index in the array")
            return element, lambda scope: scope[name][index - low]
        return kind, lambda scope: scope[name]

    def function(self, name):
        self.take("(")
        if name in CONVERSIONS:
            source, target = CONVERSIONS[name]
            run = self.typed_expression(source)
            self.take(")")
            if target == "REAL":
                return target, lambda scope: float(run(scope))
            return target, lambda scope: wrapped(target, run(scope))
        if name in ("SHL", "SHR"):
            kind, run = self.disjunction("DWORD")
            if kind not in ("WORD", "DWORD"):
                self.refuse("WORD or DWORD")
            self.take(",")
            count = int(self.take_kind("int"))
            self.take(")")
            if name == "SHL":
                return kind, lambda scope: wrapped(kind, run(scope) << count)
            return kind, lambda scope: run(scope) >> count
        if name not in self.functions:
            self.refuse("a function of the standard or a declared one")
        unit = self.functions[name]
        arguments = []
        for place, variable in enumerate(unit["inputs"]):
            if place:
                self.take(",")
            arguments.append(self.typed_expression(unit["variables"][variable]))
        self.take(")")

        def call(scope):
            inner = initial_values(self, unit)
            for variable, run in zip(unit["inputs"], arguments):
                inner[variable] = run(scope)
            execute(unit["body"], inner)
            return inner[name]
        return unit["variables"][name], call


def operation(operator, kind, left, right):
    def run(scope):
        a, b = left(scope), right(scope)
        if operator == "AND":
            return (a and b) if kind == "BOOL" else a & b
        if operator == "OR":
            return (a or b) if kind == "BOOL" else a | b
        if operator in ("=", "<>", "<", ">", "<=", ">="):
            return {"=": a == b, "<>": a != b, "<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b}[operator]
        value = {"+": lambda: a + b, "-": lambda: a - b, "*": lambda: a * b,
                 "/": lambda: a / b if kind == "REAL" else a // b}[operator]()
        return wrapped(kind, value)
    return run


def execute(body, scope):
    for statement in body:
        statement(scope)


def initial_values(machine, unit):
    values = {}
    for name, kind in unit["variables"].items():
        if name in unit["initial"]:
            values[name] = unit["initial"][name]
        elif kind == "TON":
            values[name] = TON(machine)
        elif kind in machine.types:
            _, low, high, _ = machine.types[kind]
            values[name] = [0] * (high - low + 1)
        else:
            values[name] = {"BOOL": False, "REAL": 0.0}.get(kind, 0)
    return values


class Instance:
    """A function block with its memory: call it with inputs by name, read outputs as attributes. `shared` holds the
    variables of its VAR_IN_OUT; blocks that are given the same ones share them."""

    def __init__(self, machine, unit, shared=None):
        self.unit, self.scope = unit, initial_values(machine, unit)
        self.shared = {} if shared is None else shared
        for name in unit["shared"]:
            self.shared.setdefault(name, self.scope[name])

    def __call__(self, **inputs):
        for name, value in inputs.items():
            assert name in self.unit["inputs"], name
            self.scope[name] = value
        self.scope.update(self.shared)
        execute(self.unit["body"], self.scope)
        self.shared.update({name: self.scope[name] for name in self.unit["shared"]})
        return self

    def __getattr__(self, name):
        return self.scope[name]

    def outputs(self):
        return {name: self.scope[name] for name in self.unit["outputs"]}
