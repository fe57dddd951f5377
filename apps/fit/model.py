"""What a fit compares: measured rows, the scene's answers to them, and how both change with the constants."""
import csv
import math
import re

import numpy as np
from swing import swing

QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
FACTOR = re.compile(r"\s*(?:(\d+\.?\d*|\.\d+)\s*\*(?=\s*\w))?(.*)", re.DOTALL)  # "4*viscosity.terms[1].time"; the "*" of "materials.*" stays
AXES = {"x": 0, "y": 1, "z": 2}
SWINGS = ("period", "decrement")
STEP = 1e-3  # of a constant's logarithm, or of its range, for differences of rests
SWING_STEP = 0.02  # the same, for differences of motions
SHIFT = 1e-4  # the same, for differences of forces at one displacement (adjoint)


class Bad(Exception):
    """Bad input: what is wrong; what to do."""


class Constant:
    """A constant to fit: PATH=LOW..HIGH or PATH=LOW..START..HIGH. Positive ones are fitted by their logarithm. `PATH, 4*PATH=...` sets several keys: each to
    the constant times its factor."""

    def __init__(self, text):
        self.path, equals, span = text.partition("=")
        self.places = [(float(m[1] or 1), m[2].strip()) for m in (FACTOR.fullmatch(p) for p in self.path.split(","))]
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
        """Returns the settings of the scene, one for each of its keys."""
        return [f"{path}={factor * self.outer(inner):.12g}{' ' + self.unit if self.unit else ''}" for factor, path in self.places]


class Compared:
    """A column and what of the simulation it is: COLUMN=[-]support NAME AXIS, point NAME AXIS, instrument N AXIS, or of a swing `period NAME AXIS`,
    `decrement NAME AXIS`, NAME a point."""

    def __init__(self, text, points):
        self.column, equals, what = text.partition("=")
        words = what.replace("-", "- ").split() if what.startswith("-") else what.split()
        self.sign = -1.0 if words[:1] == ["-"] else 1.0
        words = words[words[:1] == ["-"]:]
        if not equals or len(words) < 3 or words[0] not in ("support", "point", "instrument", *SWINGS) or words[-1] not in AXES:
            raise Bad(f"--compare {text}: not COLUMN=WHAT; write force_N=-support top z, or m1_z_m=point m1 z, or force_N=instrument 0 z, or T_s=period m1 z")
        self.kind, self.name, self.axis = words[0], " ".join(words[1:-1]), AXES[words[-1]]
        self.swings = self.kind in SWINGS
        if self.kind in ("point", *SWINGS) and self.name not in points:
            raise Bad(f"--compare {text}: there is no point '{self.name}'; add --point {self.name}=X,Y,Z (m, at rest)")

    def quantity(self, points):
        """Returns what a request for slopes calls it; None: it has no adjoint."""
        if self.kind == "point":
            return ["point", list(points).index(self.name), self.axis]
        return ["support", self.name, self.axis] if self.kind == "support" else None

    def values(self, answer, points):
        """Returns the simulation's values, one a time; of a swing one."""
        if self.swings:
            x = [row[list(points).index(self.name)][self.axis] for row in answer["points_m"]]
            found = swing(answer["time_s"], x)[SWINGS.index(self.kind)]
            if not math.isfinite(found):
                raise Bad(f"--compare {self.column}: the point {self.name} does not swing in the time of --swing; give a longer one, or less viscosity")
            return np.array([found])
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
    """Returns {column: values}; NaN where a cell is empty: that was not measured."""
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
                table[name].append(float(text) if text.strip() else float("nan"))
            except ValueError:
                raise Bad(f"{path}:{number}: '{text}' of column {name} is not a number; write one, in SI units") from None
            if text.strip() and not math.isfinite(table[name][-1]):
                raise Bad(f"{path}:{number}: column {name} is not finite; remove the row, or leave the cell empty") from None
    return {name: np.array(values) for name, values in table.items()}


def columns_of(texts):
    """Returns the columns that settings name as {column}."""
    return [n for s in texts for n in re.findall(r"\{(\w+)\}", s)]


class Problem:
    """Measured values, and the simulation's at given constants. `rows` of a curve are settled one by one, and run for `swing_s` where a period or decrement was
    measured; a series over time is run once for each set of values that --row sets. any_start: offset, size and phase of a series are not compared."""

    def __init__(self, constants, data, row_sets, compared, points, time_column=None, tolerance=1e-8, from_first=False, noise=None, adjoint=True, swing_s=0.0, any_start=False):
        self.constants, self.compared, self.points, self.time = constants, compared, points, time_column
        self.tolerance, self.from_first, self.row_sets, self.data = tolerance, from_first, row_sets, data
        self.swing_s, self.any_start = swing_s, any_start
        self.evaluations, self.solutions = 0, 0
        self.doubts = {}  # row: what is doubtful about its last equilibrium
        self.differences = "" if adjoint else "asked for"  # why derivatives are differences of rests; empty: they are the adjoint's
        if adjoint and time_column is not None:
            self.differences = "a series over time is no rest"
        elif adjoint and any(c.swings for c in compared):
            self.differences = "a swing is no rest"
        elif adjoint and any(c.kind == "instrument" for c in compared):
            self.differences = "contact with an instrument is not smooth"
        self._check()
        measured = np.stack([data[c.column] for c in compared], 1)
        self.moved = np.array([from_first and not c.swings for c in compared])  # columns that are differences from the first row
        self.measured = measured - np.where(self.moved, measured[0], 0)
        self.known = np.isfinite(self.measured)
        self.count = len(measured)
        self.scale = np.stack([self._noise(m, (noise or {}).get(c.column)) for c, m in zip(compared, self.measured.T)], 1)
        self.runs = self._runs()

    def _check(self):
        settings = columns_of(self.row_sets) + ([self.time] if self.time else [])
        for name in [c.column for c in self.compared] + settings:
            if name not in self.data:
                raise Bad(f"column {name} is not in the data; it has {', '.join(self.data)}")
        for name in settings:
            if not np.isfinite(self.data[name]).all():
                raise Bad(f"column {name} has empty cells, and the scene is set by it; fill them in")
        for c in self.compared:
            if c.swings and (self.time or not self.swing_s > 0):
                raise Bad(f"--compare {c.column}: a {c.kind} needs a curve and --swing TIME; give the time to run after the release, and no --time")
            if not np.isfinite(self.data[c.column]).any():
                raise Bad(f"column {c.column} is empty; leave its --compare out")
            if self.from_first and not c.swings and not np.isfinite(self.data[c.column][0]):
                raise Bad(f"column {c.column} has no value in the first row, and --from-first compares with it; put a measured row first")

    def _runs(self):
        """Returns the rows of each run: those of a series between which --row sets nothing else; each row of a curve."""
        if self.time is None:
            return [[row] for row in range(self.count)]
        names, runs = columns_of(self.row_sets), {}
        for row in range(self.count):
            runs.setdefault(tuple(self.data[n][row] for n in names), []).append(row)
        return list(runs.values())

    @staticmethod
    def _noise(measured, told):
        """Returns the standard deviation of each value of a column: a number, ("%", share) of each value, or None: the column's own size."""
        size = float(np.sqrt(np.nanmean(measured**2))) or 1.0
        if isinstance(told, tuple):
            return told[1] * np.maximum(np.nan_to_num(np.abs(measured)), 1e-3 * size)
        return np.full(len(measured), told or size)

    def sets(self, inner, row):
        values = {name: f"{column[row]:.12g}" for name, column in self.data.items()}
        return [w for c, x in zip(self.constants, inner) for w in c.words(x)] + [re.sub(r"\{(\w+)\}", lambda m: values[m[1]], s) for s in self.row_sets]

    def _picked(self, answer):
        return np.stack([c.values(answer, self.points) for c in self.compared], 1)

    def _ask(self, trials, inner, run, cold=False):
        """Returns the simulated values of a run (rows, m)."""
        self.evaluations += 1
        where, row = list(self.points.values()), run[0]
        if self.time is not None:
            times = self.data[self.time][run]
            answer = trials.ask(self.sets(inner, row), duration_s=float(times.max()), points_m=where)
            return self._at_times(times, answer)
        values = np.full((1, len(self.compared)), np.nan)
        for swings in (False, True):
            asked = [j for j, c in enumerate(self.compared) if c.swings == swings and (self.known[row, j] or (self.moved[j] and row == 0))]
            if asked:
                what = {"duration_s": self.swing_s} if swings else {"settle": self.tolerance, "cold": cold}
                answer = trials.ask(self.sets(inner, row), points_m=where, **what)
                self.doubts[row] = answer.get("doubt")
                for j in asked:
                    values[0, j] = self.compared[j].values(answer, self.points)[0]
        return values

    def _at_times(self, times, answer):
        """Returns a series' values at the measured times; with any_start also their rates: (n, m), or (n, m, 2)."""
        simulated, found = np.array(answer["time_s"]), self._picked(answer)
        values = np.stack([np.interp(times, simulated, column) for column in found.T], 1)
        if not self.any_start:
            return values
        rates = np.stack([np.interp(times, simulated, np.gradient(column, simulated)) for column in found.T], 1)
        return np.stack([values, rates], -1)

    def shifted(self, inner, k, by):
        moved = np.array(inner, float)
        moved[k] += by
        return moved

    def step(self, inner, k):
        """Returns the step of constant k that stays within its range."""
        size = SWING_STEP if any(c.swings for c in self.compared) else STEP
        return -size if self.constants[k].inner(self.constants[k].high) - inner[k] < size else size

    def _pairs(self, inner, row):
        """Returns (settings of the shifted constants (p, 2), their distances). Where rows only move supports or loads, all rows share those of the first."""
        shared = all(re.match(r"(supports|loads)\b", s) for s in self.row_sets) and not any(re.match(r"(supports|loads)\b", p) for c in self.constants for _, p in c.places)
        pairs, distance = [], []
        for k, c in enumerate(self.constants):
            ends = [self.shifted(inner, k, np.clip(inner[k] + by, c.inner(c.low), c.inner(c.high)) - inner[k]) for by in (SHIFT, -SHIFT)]
            pairs.append([self.sets(e, 0 if shared else row) for e in ends])
            distance.append(ends[0][k] - ends[1][k])
        return pairs, np.array(distance)

    def _adjoint(self, trials, inner, row, cold):
        """Returns (values (1, m), derivatives (1, m, p)) of a row by one rest and one solution with its tangent a value; derivatives None: by differences, self.differences says why."""
        self.evaluations += 1
        pairs, distance = self._pairs(inner, row)
        answer = trials.ask(self.sets(inner, row), settle=self.tolerance, points_m=list(self.points.values()), cold=cold,
                            slopes={"of": [c.quantity(self.points) for c in self.compared], "by": pairs})
        self.doubts[row] = answer.get("doubt")
        values = self._picked(answer)
        if answer["slopes"] is None:
            self.differences = answer["why"]
            return values, None
        self.solutions += len(self.compared)
        return values, (np.array([c.sign for c in self.compared])[:, None] * np.array(answer["slopes"]) / distance)[None]

    def _slope(self, trials, inner, run, base, told):
        """Returns derivatives (..., p) by differences: each rest starts from the one before, and is one solution with the tangent there, or two."""
        slope = []
        for k in range(len(self.constants)):
            by = self.step(inner, k)
            slope.append((self._ask(trials, self.shifted(inner, k, by), run) - base) / by)
            told((k + 1) / len(self.constants))
        return np.stack(slope, -1)

    def _fit_start(self, run, base, slope):
        """Fits offset, size and phase of each column of a series: measured = a + b x + c dx/dt. Returns values (n, m) and derivatives (n, m, p), by which the
        three follow the constants (Kaufman's variable projection)."""
        values, slopes = np.full(base.shape[:2], np.nan), np.zeros(slope.shape[:2] + slope.shape[3:])
        for j in range(base.shape[1]):
            known = self.known[run, j]
            basis = np.column_stack([np.ones(known.sum()), base[known, j]])
            share = np.linalg.lstsq(basis, self.measured[run, j][known], rcond=None)[0]
            values[known, j] = basis @ share
            moved = np.tensordot(slope[known, j], share[1:], axes=(1, 0))
            slopes[known, j] = moved - basis @ np.linalg.lstsq(basis, moved, rcond=None)[0]
        return values, slopes

    def at(self, trials, inner, told=lambda share: None, derivatives=True, data_rows=None):
        """Returns (values (n, m), derivatives (n, m, p)): by the adjoint of each rest, or by differences of rests. The first row starts from no displacement,
        so that the answer does not depend on what was asked before: a fit that is resumed has the same bits."""
        runs = [[row] for row in data_rows] if data_rows is not None else self.runs
        p = len(self.constants) if derivatives else 0
        values, slopes = np.full((len(runs) if self.time is None else self.count, len(self.compared)), np.nan), None
        slopes = np.zeros((*values.shape, p))
        for done, run in enumerate(runs):
            place, slope = ([done] if self.time is None else run), None
            if derivatives and not self.differences:
                base, slope = self._adjoint(trials, inner, run[0], cold=not done)
            else:
                base = self._ask(trials, inner, run, cold=not done)
            if derivatives and slope is None:
                slope = self._slope(trials, inner, run, base, lambda share: told((done + share) / len(runs)))
            if slope is None:
                slope = np.zeros((*base.shape, 0))
            values[place], slopes[place] = self._fit_start(run, base, slope) if self.any_start else (base, slope)
            told((done + 1) / len(runs))
        if self.from_first:
            values, slopes = values - np.where(self.moved, values[0], 0), slopes - np.where(self.moved[:, None], slopes[0], 0)
        return values, slopes
