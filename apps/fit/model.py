"""What a fit compares: measured rows, the scene's answers to them, and how both change with the constants."""
import csv
import math
import re

import numpy as np

QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
AXES = {"x": 0, "y": 1, "z": 2}
STEP = 1e-3  # of a constant's logarithm, or of its range, for differences of rests
SHIFT = 1e-4  # the same, for differences of forces at one displacement (adjoint)


class Bad(Exception):
    """Bad input: what is wrong; what to do."""


class Constant:
    """A constant to fit: PATH=LOW..HIGH or PATH=LOW..START..HIGH. Positive ones are fitted by their logarithm."""

    def __init__(self, text):
        self.path, equals, span = text.partition("=")
        parts = [QUANTITY.fullmatch(p) for p in span.split("..")] if equals else []
        if len(parts) not in (2, 3) or not all(parts) or not self.path:
            raise Bad(f"--fit {text}: no range; write --fit 'tissue.materials.*.young=1 kPa..50 kPa', or LOW..START..HIGH")
        values, units = [float(p[1]) for p in parts], [p[2] for p in parts if p[2]]
        if len(set(units)) > 1:
            raise Bad(f"--fit {text}: two units; write both ends in one")
        self.unit, self.low, self.high = (units or [""])[0], values[0], values[-1]
        if not self.low < self.high:
            raise Bad(f"--fit {text}: the range is empty; put the lower end first")
        self.log = self.low > 0
        self.start = values[1] if len(values) == 3 else math.sqrt(self.low * self.high) if self.log else (self.low + self.high) / 2
        if not self.low <= self.start <= self.high:
            raise Bad(f"--fit {text}: the start is outside the range; change one of them")

    def inner(self, value):
        return math.log(value) if self.log else (value - self.low) / (self.high - self.low)

    def outer(self, inner):
        return math.exp(inner) if self.log else self.low + inner * (self.high - self.low)

    def words(self, inner):
        return f"{self.path}={self.outer(inner):.12g}{' ' + self.unit if self.unit else ''}"


class Compared:
    """A column and what of the simulation it is: COLUMN=[-]support NAME AXIS, point NAME AXIS or instrument N AXIS."""

    def __init__(self, text, points):
        self.column, equals, what = text.partition("=")
        words = what.replace("-", "- ").split() if what.startswith("-") else what.split()
        self.sign = -1.0 if words[:1] == ["-"] else 1.0
        words = words[words[:1] == ["-"]:]
        if not equals or len(words) < 3 or words[0] not in ("support", "point", "instrument") or words[-1] not in AXES:
            raise Bad(f"--compare {text}: not COLUMN=WHAT; write force_N=-support top z, or m1_z_m=point m1 z, or force_N=instrument 0 z")
        self.kind, self.name, self.axis = words[0], " ".join(words[1:-1]), AXES[words[-1]]
        if self.kind == "point" and self.name not in points:
            raise Bad(f"--compare {text}: there is no point '{self.name}'; add --point {self.name}=X,Y,Z (m, at rest)")

    def quantity(self, points):
        """Returns what a request for slopes calls it; None: it has no adjoint."""
        if self.kind == "point":
            return ["point", list(points).index(self.name), self.axis]
        return ["support", self.name, self.axis] if self.kind == "support" else None

    def values(self, answer, points):
        """Returns the simulation's values, one a time."""
        if self.kind == "point":
            return self.sign * np.array([row[list(points).index(self.name)][self.axis] for row in answer["points_m"]])
        if self.kind == "support":
            if self.name not in answer["supports"]:
                raise Bad(f"--compare {self.column}: the scene has no support '{self.name}'; it has {', '.join(filter(None, answer['supports'])) or 'none with a name'}")
            return self.sign * np.array([row[answer["supports"].index(self.name)][self.axis] for row in answer["supports_N"]])
        if not self.name.isdigit() or int(self.name) >= len(answer["instruments_N"][0]):
            raise Bad(f"--compare {self.column}: the scene has no instrument {self.name}; count from 0")
        return self.sign * np.array([row[int(self.name)][self.axis] for row in answer["instruments_N"]])


def read_csv(path):
    """Returns {column: values}."""
    try:
        with open(path, newline="") as file:
            rows = [r for r in csv.reader(file) if r and not r[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        raise Bad(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}; give a CSV file with a header line") from None
    if len(rows) < 2:
        raise Bad(f"{path}: no rows after the header line; write the column names first, then the rows")
    head = [name.strip() for name in rows[0]]
    table = {name: [] for name in head}
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(head):
            raise Bad(f"{path}:{number}: {len(row)} values for {len(head)} columns; give one per column")
        for name, text in zip(head, row):
            try:
                table[name].append(float(text))
            except ValueError:
                raise Bad(f"{path}:{number}: '{text}' of column {name} is not a number; write one, in SI units") from None
            if not math.isfinite(table[name][-1]):
                raise Bad(f"{path}:{number}: column {name} is not finite; remove the row") from None
    return {name: np.array(values) for name, values in table.items()}


class Problem:
    """Measured values, and the simulation's at given constants. `rows` of a curve are settled one by one; a series over time is run once."""

    def __init__(self, constants, data, row_sets, compared, points, time_column=None, tolerance=1e-8, from_first=False, noise=None, adjoint=True):
        self.constants, self.compared, self.points, self.time = constants, compared, points, time_column
        self.tolerance, self.from_first, self.row_sets, self.data = tolerance, from_first, row_sets, data
        self.evaluations, self.solutions = 0, 0
        self.differences = "" if adjoint else "asked for"  # why derivatives are differences of rests; empty: they are the adjoint's
        if adjoint and time_column is not None:
            self.differences = "a series over time is no rest"
        elif adjoint and any(c.kind == "instrument" for c in compared):
            self.differences = "contact with an instrument is not smooth"
        for name in [c.column for c in compared] + ([time_column] if time_column else []) + [n for s in row_sets for n in re.findall(r"\{(\w+)\}", s)]:
            if name not in data:
                raise Bad(f"column {name} is not in the data; it has {', '.join(data)}")
        measured = np.stack([data[c.column] for c in compared], 1)
        self.measured = measured - measured[0] if from_first else measured
        self.count = len(measured)
        self.scale = np.stack([self._noise(m, (noise or {}).get(c.column)) for c, m in zip(compared, self.measured.T)], 1)

    @staticmethod
    def _noise(measured, told):
        """Returns the standard deviation of each value of a column: a number, ("%", share) of each value, or None: the column's own size."""
        size = float(np.sqrt(np.mean(measured**2))) or 1.0
        if isinstance(told, tuple):
            return told[1] * np.maximum(np.abs(measured), 1e-3 * size)
        return np.full(len(measured), told or size)

    def sets(self, inner, row):
        values = {name: f"{column[row]:.12g}" for name, column in self.data.items()}
        return [c.words(x) for c, x in zip(self.constants, inner)] + [re.sub(r"\{(\w+)\}", lambda m: values[m[1]], s) for s in self.row_sets]

    def _picked(self, answer):
        return np.stack([c.values(answer, self.points) for c in self.compared], 1)

    def _ask(self, trials, inner, row, cold=False):
        self.evaluations += 1
        where = list(self.points.values())
        if self.time is None:
            return self._picked(trials.ask(self.sets(inner, row), settle=self.tolerance, points_m=where, cold=cold))[0]
        times = self.data[self.time]
        answer = trials.ask(self.sets(inner, 0), duration_s=float(times.max()), points_m=where)
        found = self._picked(answer)
        return np.stack([np.interp(times, answer["time_s"], column) for column in found.T], 1)

    def shifted(self, inner, k, by):
        moved = np.array(inner, float)
        moved[k] += by
        return moved

    def step(self, inner, k):
        """Returns the step of constant k that stays within its range."""
        return -STEP if self.constants[k].inner(self.constants[k].high) - inner[k] < STEP else STEP

    def _pairs(self, inner, row):
        """Returns (settings of the shifted constants (p, 2), their distances). Where rows only move supports or loads, all rows share those of the first."""
        shared = all(re.match(r"(supports|loads)\b", s) for s in self.row_sets) and not any(re.match(r"(supports|loads)\b", c.path) for c in self.constants)
        pairs, distance = [], []
        for k, c in enumerate(self.constants):
            ends = [self.shifted(inner, k, np.clip(inner[k] + by, c.inner(c.low), c.inner(c.high)) - inner[k]) for by in (SHIFT, -SHIFT)]
            pairs.append([self.sets(e, 0 if shared else row) for e in ends])
            distance.append(ends[0][k] - ends[1][k])
        return pairs, np.array(distance)

    def _adjoint(self, trials, inner, row, cold):
        """Returns (values (m,), derivatives (m, p)) of a row by one rest and one solution with its tangent a value; derivatives None: by differences, self.differences says why."""
        self.evaluations += 1
        pairs, distance = self._pairs(inner, row)
        answer = trials.ask(self.sets(inner, row), settle=self.tolerance, points_m=list(self.points.values()), cold=cold,
                            slopes={"of": [c.quantity(self.points) for c in self.compared], "by": pairs})
        values = self._picked(answer)[0]
        if answer["slopes"] is None:
            self.differences = answer["why"]
            return values, None
        self.solutions += len(self.compared)
        return values, np.array([c.sign for c in self.compared])[:, None] * np.array(answer["slopes"]) / distance

    def _slope(self, trials, inner, row, base, told):
        """Returns derivatives (..., p) by differences: each rest starts from the one before, and is one solution with the tangent there, or two."""
        slope = []
        for k in range(len(self.constants)):
            by = self.step(inner, k)
            slope.append((self._ask(trials, self.shifted(inner, k, by), row) - base) / by)
            told((k + 1) / len(self.constants))
        return np.stack(slope, -1)

    def at(self, trials, inner, told=lambda share: None, derivatives=True, data_rows=None):
        """Returns (values (n, m), derivatives (n, m, p)): by the adjoint of each rest, or by differences of rests. The first row starts from no displacement,
        so that the answer does not depend on what was asked before: a fit that is resumed has the same bits."""
        rows = list(data_rows if data_rows is not None else range(self.count)) if self.time is None else [0]
        values, slopes = [], []
        for done, row in enumerate(rows):
            slope = None
            if derivatives and not self.differences:
                base, slope = self._adjoint(trials, inner, row, cold=not done)
            else:
                base = self._ask(trials, inner, row, cold=not done)
            if derivatives and slope is None:
                slope = self._slope(trials, inner, row, base, lambda share: told((done + share) / len(rows)))
            values.append(base)
            slopes.append(slope if derivatives else np.zeros(base.shape + (0,)))
            told((done + 1) / len(rows))
        if self.time is not None:
            values, slopes = values[0], slopes[0]
        values, slopes = np.array(values), np.array(slopes)
        if self.from_first:
            values, slopes = values - values[0], slopes - slopes[0]
        return values, slopes
