"""The writer of pages: self-contained, escaped, in both themes; numbers as a person reads them."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import matplotlib.image
import pytest

from stage_core import theme
from stage_core.errors import StageError
from stage_core.pages import Page, add_conditions
from stage_core.wording import effect_words, measure, rounded, span, with_interval, with_std
from stage_reports import figures

from ..browser import browse, needs_chromium, told


def test_the_page_is_self_contained_and_escaped(tmp_path: Path) -> None:
    page = Page('A & <b>')
    page.headline('<1 µm', 'meaning', 'brief').conditions([('Machine', 'x<y'), ('None', '')])
    page.heading('Part').text('one\n\ntwo <script>alert(1)</script> `code`')
    page.table(['name', 'value'], [['x<y', 1.23456e-6], ['none', None]], 'numbers')
    page.figure(figures.time_series([0.0, 1.0], {'a': [0.0, 1.0]}, 'µm'), 'a "picture"', 'Look.')
    page.navigation([('Session', 'report.html'), ('Here', '')])
    html = page.save(tmp_path / 'deep' / 'report.html').read_text(encoding='utf-8')
    assert '<script' not in html
    assert '&lt;script&gt;' in html
    assert '<code>code</code>' in html
    assert 'x&lt;y' in html and 'None' not in html
    assert 'alt="a &quot;picture&quot;"' in html
    assert '<a href="report.html">Session</a>' in html
    assert page.brief == '<1 µm brief'
    # Paper is light, and pictures follow the scheme of the page.
    assert '@media print{html{color-scheme:light}' in html
    add_conditions(tmp_path / 'deep' / 'report.html', [('Model', 'a<b'), ('None', '')])
    added = (tmp_path / 'deep' / 'report.html').read_text(encoding='utf-8')
    assert '<dl><div><dt>Model</dt><dd>a&lt;b</dd></div><div><dt>Machine' in added
    # Nothing is loaded: the only addresses are data.
    assert not re.search(r'(src|href)="(?!data:|report\.html)', html)


def test_a_picture_has_the_colours_of_both_themes() -> None:
    text = theme.svg(figures.time_series([0.0, 1.0], {'a': [0.0, 1.0]}, 'µm'))
    ElementTree.fromstring(text)
    drawing = text[text.index('</style>') :]
    assert 'var(--blue)' in drawing and 'var(--ink)' in drawing
    assert not set(re.findall(r'#[0-9a-f]{6}\b', drawing)) & {c for c, _ in theme.COLOURS.values()}
    assert '@media screen and (prefers-color-scheme:dark)' in text
    assert theme.svg(figures.time_series([0.0, 1.0], {'a': [0.0, 1.0]}, 'µm')) == text


@needs_chromium
@pytest.mark.parametrize('dark', [False, True])
def test_page_and_picture_follow_the_same_theme(tmp_path: Path, dark: bool) -> None:
    page = Page('theme').figure(figures.histogram({'a': [0.0, 1.0, 2.0]}), 'a picture', 'Look.')
    shot = tmp_path / 'shot.png'
    browse(
        page.save(tmp_path / 'page.html'),
        f'--blink-settings=preferredColorScheme={0 if dark else 1}',
        '--window-size=700,600',
        f'--screenshot={shot}',
    )
    luminance = matplotlib.image.imread(shot)[:, :, :3].mean(axis=2)
    corner, ink = luminance[:5, :5].mean(), luminance[90:400]
    # The picture's letters stand out from the page, whichever theme it has.
    assert (corner < 0.2) if dark else (corner > 0.9)
    contrast = ink.max() - corner if dark else corner - ink.min()
    assert contrast > 0.6


#: Points at a share of the width, drags over a stretch and points there again, as a mouse does.
MOUSE = """<script>addEventListener('load', () => {
const canvas = document.querySelector('canvas'), [panel] = JSON.parse(
  document.querySelector('script.curves').textContent);
const phone = matchMedia('(max-width:40rem)').matches;
const box = canvas.getBoundingClientRect(), [left, top, width] = panel.places[Number(phone)].box;
const mouse = (kind, share) => canvas.dispatchEvent(new PointerEvent(kind, {
  clientX: box.left + box.width * (left + width * share),
  clientY: box.top + box.height * (top + 0.1), pointerType: 'mouse', bubbles: true}));
const said = share => {
  mouse('pointermove', share); return document.querySelector('output').textContent; };
const found = [said(0.5)];
mouse('pointerdown', 0.2); mouse('pointermove', 0.4); mouse('pointerup', 0.4);
found.push(said(0.5));
canvas.dispatchEvent(new MouseEvent('dblclick'));
found.push(said(0.5));
document.title = JSON.stringify(found);
});</script>"""


@needs_chromium
@pytest.mark.parametrize('width', [1200, 500])
def test_a_reader_reads_values_off_curves_and_zooms(tmp_path: Path, width: int) -> None:
    seconds = [0.0, 20.0, 30.0, 50.0, 100.0]
    figure = figures.time_series(seconds, {'a</script>': [1.0, 2.0, 3.0, 5.0, -9.0]}, 'µm')
    page = Page('curves').figure(figure, 'a picture', 'Look.', curves=True)
    assert page.render().count('</script>') == 2
    place = tmp_path / 'page.html'
    place.write_text(page.render().replace('</body>', MOUSE + '</body>'), encoding='utf-8')
    said = told(place, f'--window-size={width},900')
    pairs = [re.findall(r' at (\S+): a</script> (\S+)', text)[0] for text in said]
    places = [float(x) for x, _ in pairs]
    # The middle of the whole, of the stretch from 0.2 to 0.4 of it, and of the whole again.
    assert places == pytest.approx([50.0, 30.0, 50.0], abs=1.0)
    assert [float(y) for _, y in pairs] == [5.0, 3.0, 5.0]


def test_neighbouring_pictures_share_a_row() -> None:
    page = Page('rows')
    small = figures.histogram({'a': [0.0, 1.0, 2.0]})
    page.figure(small, 'one', 'Look.').figure(small, 'two', 'Look.').text('between').figure(
        small, 'three', 'Look.'
    )
    html = page.render()
    assert html.count('class="figures"') == 2
    images = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', html)
    assert all(base64.b64decode(image).startswith(b'<svg') for image in images)
    assert len(images) == 3


def sizes(html: str) -> list[tuple[float, float]]:
    """Width and height [pt] of the pictures of a page: for a phone first, where there is one."""
    images = re.findall(r'"data:image/svg\+xml;base64,([^"]+)"', html)
    texts = [base64.b64decode(image).decode() for image in images]
    found = [re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', text) for text in texts]
    return [(float(size[1]), float(size[2])) for size in found if size is not None]


def test_the_panels_of_a_wide_picture_stand_in_one_column_on_a_phone() -> None:
    places, errors = [[0.0, 0.0], [0.02, 0.01]], [[1e-6, 0.0], [0.0, 2e-6]]
    both = figures.error_map(places, errors, errors)
    (width, height), wide = sizes(Page('maps').figure(both, 'two maps', 'Look.').render())
    assert width == pytest.approx(72.0 * theme.NARROW)
    assert height == pytest.approx(2.0 * wide[1], abs=0.1)
    # The figure itself is as before: its PNG is the wide one.
    assert wide == pytest.approx(72.0 * both.get_size_inches(), abs=0.1)
    left, right = (axes.get_position() for axes in both.axes)
    assert left.y0 == pytest.approx(right.y0) and left.x1 < right.x0
    page = Page('one').figure(figures.histogram({'a': [0.0, 1.0]}), 'one', 'Look.')
    assert len(sizes(page.render())) == 1


#: Says of a page in a frame as wide as a phone what is wider than its place.
PHONE = """<iframe width="390" height="900"></iframe><script>
const frame = document.querySelector('iframe');
frame.onload = () => {
  const inside = [...frame.contentDocument.querySelectorAll('html,.scroll,.plot')];
  document.title = JSON.stringify(inside.map(e => e.scrollWidth - e.clientWidth));
};
frame.srcdoc = PAGE;</script>"""


@needs_chromium
def test_nothing_scrolls_sideways_on_a_phone(tmp_path: Path) -> None:
    page = Page('phone').figure(
        figures.time_series([0.0, 1.0], {'a': [0.0, 1.0]}, 'µm'), 'wide', 'Look.'
    )
    columns = ['run', 'contour RMS (µm)', 'contour largest (µm)', 'encoder: RMS of x (µm)']
    page.table([*columns, 'encoder: RMS of y (µm)'], [['1', '3.77', '30.6', '3.74', '3.87']])
    text = json.dumps(page.render()).replace('</', '<\\/')
    place = tmp_path / 'frame.html'
    place.write_text(PHONE.replace('PAGE', text), encoding='utf-8')
    assert told(place) == [0, 0, 0]


def test_a_row_of_sentences_becomes_a_list_on_a_phone() -> None:
    page = Page('tables').table(['a', 'b'], [['1', '2.3 ± 0.1 µm']])
    assert 'class="prose"' not in page.render()
    page.table(['effect', 'what it does'], [['play', 'the table follows the motor late']])
    html = page.render()
    assert html.count('class="prose"') == 1
    assert '<td data-of="what it does">the table follows the motor late</td>' in html


def test_the_page_refuses_what_does_not_fit(tmp_path: Path) -> None:
    page = Page('r')
    with pytest.raises(StageError, match='cells'):
        page.table(['a', 'b'], [[1]])
    (tmp_path / 'file').write_text('')
    with pytest.raises(StageError, match='cannot write'):
        page.save(tmp_path / 'file' / 'report.html')


@pytest.mark.parametrize(
    ('said', 'expected'),
    [
        (with_std(7.977e-6, 5e-8), '7.98 ± 0.05 µm'),
        (with_std(5.957, 0.0121, 'N'), '5.957 ± 0.012 N'),
        (with_std(-6.861e-6, 7e-7, 'rad'), '−6.9 ± 0.7 µrad'),
        (with_std(0.7048, 0.01, 'rad'), '0.705 ± 0.010 rad'),
        (with_std(1.0, float('nan'), 'N'), '1.00 N'),
        (with_interval(0.927e-6, 0.68e-6, 1.46e-6), '0.93 µm (95 %: 0.68 to 1.46 µm)'),
        (measure(9.27e-7), '0.927 µm'),
        (measure(0.0400001), '40.0 mm'),
        (span(-40.0, 40.0, 'mm'), '−40 to 40 mm'),
        (span(20.0, 20.01, '°C', 1), '20.0 °C'),
        (effect_words('coulomb_friction.x'), 'Coulomb friction of x'),
        (effect_words('nonorthogonality'), 'nonorthogonality'),
    ],
)
def test_numbers_and_names(said: str, expected: str) -> None:
    assert said == expected


def test_a_value_has_the_digits_that_its_deviation_allows() -> None:
    assert rounded(-6.58e-6, 8e-6) == -7e-6
    assert rounded(5.9449, 0.0212) == 5.94
    assert rounded(1.234, 0.0) == 1.234
