"""Prints a table of docs/results/papers.md: the figures of a paper beside those of this project.

`python tools/papers.py 4` takes ours from the output of the commands in docs/results. A cell
``{ROW:N}`` holds number N of the first line there that begins with ROW, ``{ROW@2:N}`` that of the second, and
``{ROW:N,M}`` two numbers.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[1] / 'docs' / 'results'
CELL = re.compile(r'\{([^{}@]+?)(?:@(\d))?:([\d,]+)\}')
NUMBER = re.compile(r'(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')
#: Page and section with the output, and the table: what, theirs, ours.
TABLES = {
    '1': (
        'calibration.md',
        'Paper 1, table 2',
        """
| table 2 | paper | ours |
|---|---|---|
| uncalibrated, MAE test | {paper raw:2} | {identity:4} ± {identity:5} |
| uncalibrated, σ test | {paper raw:3} | {identity:6} ± {identity:7} |
| IT2FLS, MAE train | {paper IT2FLS:0} | {it2fls:0} ± {it2fls:1} |
| IT2FLS, MAE test | {paper IT2FLS:2} | {it2fls:4} ± {it2fls:5} |
| IT2FLS, σ train | {paper IT2FLS:1} | {it2fls:2} ± {it2fls:3} |
| IT2FLS, σ test | {paper IT2FLS:3} | {it2fls:6} ± {it2fls:7} |
| perceptron, MAE train | {paper MLP:0} | {perceptron:0} ± {perceptron:1} |
| perceptron, MAE test | {paper MLP:2} | {perceptron:4} ± {perceptron:5} |
| perceptron, σ train | {paper MLP:1} | {perceptron:2} ± {perceptron:3} |
| perceptron, σ test | {paper MLP:3} | {perceptron:6} ± {perceptron:7} |
| affine, σ test | not given | {affine:6} ± {affine:7} |
| stage physics (`structured`), σ test | not given | {structured:6} ± {structured:7} |
""",
    ),
    '2': (
        'calibration.md',
        'Paper 2, figure 11',
        """
| figure 11, terms | paper | ours, held-out positions | ours, last 30 % of the time |
|---|---|---|---|
| geometric | {geometric:0} | {geometric:1} | {geometric:4} |
| + temperatures | {thermal:0} | {thermal:1} | {thermal:4} |
| + geometric × temperatures | {correlated:0} | {correlated:1} | {correlated:4} |
| + derivatives of temperatures | {derivatives:0} | {derivatives:1} | {derivatives:4} |
| terms kept of 217 | 74 (X) | {derivatives:2} | {derivatives:5} |
""",
    ),
    '3': (
        'contour.md',
        'Tables 2 and 3 of the paper',
        """
| tables 2 and 3 | paper X / Y / contour | ours X / Y / contour |
|---|---|---|
| scheme 1: PI + CCCMAC (ours: first lap) | 215.874 / 217.527 / 16.455 | {1, first lap:0,3,6} |
| scheme 1, ours: lap 30 | | {1, lap 30:0,3,6} |
| scheme 2: + ILC (ours: iteration 30) | 34.517 / 31.021 / 13.058 | {2, iteration 30:0,3,6} |
| scheme 3: + fuzzy regulator (ours: iteration 30) | 15.221 / 22.126 / 8.524 | {3, iteration 30:0,3,6} |
| scheme 1 ÷ scheme 3, ours after equal laps | 14.2 / 9.8 / 1.93 | {3 against 1 (lap 30):0,3,6} ({3 against 1 (lap 30):7} to {3 against 1 (lap 30):8}) |
| scheme 2 as printed, without lead: best iteration | | {2 as printed, best iteration:0,3,6} |
| the same, iteration 30 | | {2 as printed, iteration 30:0,3,6} |
| scheme 3 as printed, without lead: iteration 30 | | {3 as printed, iteration 30:0,3,6} |
| scheme 1 ÷ scheme 3 as printed, ours after equal laps | | {3 as printed against 1 (lap 30):0,3,6} ({3 as printed against 1 (lap 30):7} to {3 as printed against 1 (lap 30):8}) |
| norm-optimal ILC on a model (peer, K_f = 1) | not given | {norm-optimal ILC, iteration 30:0,3,6} |
| scheme 3 with K_f = 1 | not given | {3, iteration 30@2:0,3,6} |
""",
    ),
    '3figures': (
        'contour.md',
        'Figures 9 and 10 of the paper',
        """
| X tracking RMS as printed, without the lead | ours (µm) |
|---|---|
| figure 9d, first iteration | {figure 9, X RMS µm, scheme 3:0} |
| scheme 3, iteration 30 | {figure 9, X RMS µm, scheme 3:29} |
| scheme 2, iteration 6 | {figure 9, X RMS µm, scheme 2:5} |
| scheme 2, iteration 30 | {figure 9, X RMS µm, scheme 2:29} |
| figure 10, iteration 5 | {figure 10, X RMS µm:4} |
| iteration 6, with the disturbance | {figure 10, X RMS µm:5} |
| iteration 7 | {figure 10, X RMS µm:6} |
| iteration 8 | {figure 10, X RMS µm:7} |
""",
    ),
    '4': (
        'hra.md',
        '',
        """
| table | command | paper | ours |
|---|---|---|---|
| 1: relative error of HRA, n = 50 | `python -m hra_curves table1` | {n=50 HRA:0} | {n=50 HRA:1} |
| 1: of a plain solve, n = 25 | | {n=25 plain solve:0} | {n=25 plain solve:1} |
| 3: IB1, 9 points, interval 1 | `python -m hra_curves table3` | {n+1=9 interval 1 IB1:0} µm | {n+1=9 interval 1 IB1:1} µm |
| 3: IB2, 11 points, interval 1 | | {n+1=11 interval 1 IB2:0} µm | {n+1=11 interval 1 IB2:1} µm |
| 3: IB1, 7 points, interval 2 | | {n+1=7 interval 2 IB1:0} µm | {n+1=7 interval 2 IB1:1} µm |
| 6.1: points for 0.05 µm, IB1 / IB2 | | {points for 0.05 µm IB1:0} / {points for 0.05 µm IB2:0} | {points for 0.05 µm IB1:1} / {points for 0.05 µm IB2:1} |
| 4: LSB1, 501 data, 11 control points | `python -m hra_curves table4` | {l+1=501 n+1=11 LSB1:0} µm | {l+1=501 n+1=11 LSB1:1} µm |
| 4: LSB1, 51 data, 10 control points | | {l+1=51 n+1=10 LSB1:0} µm | {l+1=51 n+1=10 LSB1:1} µm |
| 4: control points of LSB1, 51 data | | {l+1=51 LSB1:0} | {l+1=51 LSB1:1} |
| 4: the same, 1001 data | | {l+1=1001 LSB1:0} | {l+1=1001 LSB1:1} |
| 4: of the CAD program / cubic B-spline, 51 data | | {l+1=51 CAD / cubic B-spline:0} | {l+1=51 CAD / cubic B-spline:1} |
| 4: the same, 251 data | | {l+1=251 CAD / cubic B-spline:0} | {l+1=251 CAD / cubic B-spline:1} |
| 5: definition error at TP1, HRA | `python -m hra_curves table5` | {TP1 HRA IB1:0} µm | {TP1 HRA IB1:1} µm |
| 5: definition error at TP3, HRA | | {TP3 HRA IB1:0} µm | {TP3 HRA IB1:1} µm |
| 5: uncertainty of the stage, k = 2 (twin, x / y) | | {twin twin_nanopla.yaml:5} µm | {twin twin_nanopla.yaml:3} / {twin twin_nanopla.yaml:4} µm |
| 5: share of the definition error at TP1, HRA / CAM | | {TP1 HRA IB1:7} / {TP1 CAM:7} % | {TP1 HRA IB1:8} / {TP1 CAM:8} % |
| 5: the same at TP3 | | {TP3 HRA IB1:7} / {TP3 CAM:7} % | {TP3 HRA IB1:8} / {TP3 CAM:8} % |
""",
    ),
    '5': (
        'calibration.md',
        'Paper 5',
        """
| entry | paper | ours |
|---|---|---|
| (11c), slopes | {paper (11c):0}, {paper (11c):2}, {paper (11c):4} | {ours (11c):0}, {ours (11c):2}, {ours (11c):4} |
| (11c), offsets | {paper (11c):1}, {paper (11c):3}, {paper (11c):5} | {ours (11c):1}, {ours (11c):3}, {ours (11c):5} |
| (11a), slope and offset of one model | -0.0470, 0.0295 | {ours (11a):0}, {ours (11a):1} |
| (15b), discrepancy of 1, 2, 3 models | {paper (15b):0}, {paper (15b):1}, {paper (15b):2} | {example I, e of eq. 12:0}, {example I, e of eq. 12:1}, {example I, e of eq. 12:2} |
| (15a), largest error of the weights | 0 to the digits printed | {largest error of w:0} |
| (16), models with noise | 3 | {example II, noise 0.2 mm:0} |
| (16), length of the rod | 1 m | {example II, noise 0.2 mm:17} m |
""",
    ),
}


def lines(page: str, section: str) -> list[str]:
    """The lines of a section, of all where it is '': spaces once, wrapped lines joined."""
    text = (RESULTS / page).read_text(encoding='utf-8')
    if section:
        (text,) = re.findall(rf'^## {re.escape(section)}$(.*?)(?=^## |\Z)', text, re.S | re.M)
    whole = re.compile(r'^- .*(?:\n  .*)*|\[[^\]]*\]', re.M)
    text = whole.sub(lambda m: m[0].replace('\n', ' '), text)
    return [' '.join(line.lstrip('|- ').split()) for line in text.splitlines()]


def figures(found: list[str], cell: re.Match[str]) -> str:
    """The numbers of a cell."""
    row, which, places = cell.groups()
    rows = [line.removeprefix(row) for line in found if re.match(rf'{re.escape(row)}(?!\w)', line)]
    numbers = NUMBER.findall(rows[int(which or 1) - 1])
    return ' / '.join(numbers[int(place)] for place in places.split(','))


def main() -> None:
    """Print the table that is named."""
    page, section, table = TABLES[sys.argv[1]]
    found = lines(page, section)
    print(CELL.sub(lambda cell: figures(found, cell), table.strip()))


if __name__ == '__main__':
    main()
