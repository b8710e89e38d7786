"""Compare the results of a tool with reference results: python compare.py mine.csv reference.csv."""

import argparse
import bisect
import csv
import re
import sys


def number(text):
    """Return the number in a cell; None for any other text."""
    text = text.strip()
    try:
        return float({"true": "1", "false": "0"}.get(text.lower(), text))
    except ValueError:
        return None


def plain(name):
    """Return a name with dots for colons and without the unit or type behind it."""
    return re.sub(r"\s*[\[(]\D[^\])]*[\])]\s*$|\s+", "", name.strip()).replace("::", ".")


def read(path):
    """Return the times of a file, and its columns by their names."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        text = file.read()
    head = text.split("\n", 1)[0]
    rows = [row for row in csv.reader(text.splitlines(), delimiter=max(",;\t", key=head.count)) if row]
    names = [plain(name) for name in rows[0]] if rows else []
    times = [i for i, name in enumerate(names) if name.lower() == "time"]
    if not times:
        raise ValueError("its first line names no column 'time'")
    body = [[number(cell) for cell in row] for row in rows[1:] if number(row[times[0]]) is not None]
    if not body or any(len(row) < len(names) for row in body):
        raise ValueError("it has no rows, or a row with too few cells")
    columns = {name: [row[i] for row in body] for i, name in enumerate(names) if i != times[0]}
    return [row[times[0]] for row in body], columns


def at(time, times, values):
    """Return a column's value at a time, on a line between two rows; None beyond them or where there is none."""
    close = 1e-9 * max(1.0, abs(time))
    i = bisect.bisect_left(times, time - close)
    if i == len(times):
        return None
    while i + 1 < len(times) and times[i + 1] <= time + close:  # the last of several rows, after an event
        i += 1
    if times[i] <= time + close:
        return values[i]
    if i == 0 or values[i] is None or values[i - 1] is None:
        return None
    return values[i - 1] + (values[i] - values[i - 1]) * (time - times[i - 1]) / (times[i] - times[i - 1])


def find(name, columns):
    """Return the column of a name, which other names may lead to."""
    found = [name] if name in columns else [other for other in columns if other.endswith("." + name)]
    return found[0] if len(found) == 1 else None


def main():
    """Compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mine")
    parser.add_argument("reference")
    parser.add_argument("--tolerance", type=float, default=1e-5, help="of a signal's largest value, default 1e-5")
    parser.add_argument("--partial", action="store_true", help="outputs that are not in the file do not count")
    options = parser.parse_args()
    tables = []
    for path in (options.mine, options.reference):
        try:
            tables.append(read(path))
        except (OSError, ValueError, csv.Error) as error:
            print(f"{path}: cannot be read: {error}")
            return 2
    (times, mine), (points, reference) = tables
    missing, wrong, worst = [], 0, (0.0, "")
    for name, wanted in reference.items():
        column = find(name, mine)
        if column is None:
            missing.append(name)
            continue
        allowed = options.tolerance * max(max(abs(y) for y in wanted), 1e-3)
        errors = []
        for time, y in zip(points, wanted):  # noqa: B905 (Python 3.8)
            x = at(time, times, mine[column])
            errors.append(float("inf") if x is None or x != x else abs(x - y))
        largest = max(errors)
        worst = max(worst, (largest / allowed * options.tolerance, name))
        if largest > allowed:
            wrong += 1
            k = errors.index(largest)
            first = next(t for t, error in zip(points, errors) if error > allowed)  # noqa: B905
            x = at(points[k], times, mine[column])
            got = "no number" if x is None else f"{x:.9g}"
            print(
                f"{name}: expected {wanted[k]:.9g} at t = {points[k]:g} s, got {got}; off by more than "
                f"{allowed:.3g} from t = {first:g} s on"
            )
    if missing:
        print(f"not in {options.mine}: {', '.join(missing)}")
    compared = len(reference) - len(missing)
    print(f"{compared - wrong} of {len(reference)} signals agree, {len(points)} rows", end="")
    print(f"; largest error {worst[0]:.3g}, {worst[1]}" if worst[1] else "")
    return 1 if wrong or not compared or (missing and not options.partial) else 0


if __name__ == "__main__":
    sys.exit(main())
