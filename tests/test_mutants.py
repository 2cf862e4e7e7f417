"""Mutants: which places change, and how one is found again in a file that has changed."""

from __future__ import annotations

from pathlib import Path

from tools.mutants.draw import find, sites

TEXT = 'def limit(x):\n    return x < 3.5 and not -x > 2\n'


def test_each_operator_and_number_is_a_place() -> None:
    changes = {site.mutant.before: site.mutant.after for site in sites(TEXT, 'p', 'f.py')}
    assert changes == {
        'x < 3.5 and not -x > 2': '(x < 3.5 or not -x > 2)',
        'x < 3.5': '(x <= 3.5)',
        '3.5': '(7.0)',
        'not -x > 2': '(-x > 2)',
        '-x > 2': '(-x >= 2)',
        '2': '(3)',
    }


def test_a_place_is_found_again_where_its_function_moved(tmp_path: Path) -> None:
    mutant = next(s.mutant for s in sites(TEXT, 'p', 'src/p/p/f.py') if s.mutant.before == '3.5')
    moved = tmp_path / 'src' / 'p' / 'p' / 'g.py'
    moved.parent.mkdir(parents=True)
    moved.write_text('import math\n\n\n' + TEXT)
    found = find(mutant, tmp_path)
    assert found == (moved, 'import math\n\n\n' + TEXT.replace('3.5', '(7.0)'))
    moved.write_text('')
    assert find(mutant, tmp_path) is None
