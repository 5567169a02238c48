"""Every report as a browser shows it: on a phone, a laptop and a wide screen, light and dark."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import CHROMIUM, NAMES, Browser, chromium
from test_finding_sentences import example_diagnosis
from test_report import TIME, fit_of

from dvrk_gravity.identification import Evaluation
from dvrk_gravity.report import diagnosis_page, evaluation_page, identification_page

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason=f"no browser to look with: none of {', '.join(NAMES)} is installed"
)

SIZES = (360, 800, 1600)  # px: a phone, half a screen, a whole one
LONG = "a_recording_with_a_name_that_has_no_place_to_break_" * 2 + ".csv"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> dict[str, Path]:
    fit = fit_of(TIME)
    units = dict.fromkeys(fit.held_out, "N·m")
    evaluation = Evaluation(
        fit.held_out, 200, "joint", "", (), ("read as it is",), fit.traces, units=units,
        recordings={LONG: fit.held_out, "b.csv": fit.held_out}, outside=("elbow_pitch",),
    )  # fmt: skip
    pages = {
        "identify": identification_page(fit, LONG),
        "evaluate": evaluation_page(evaluation, fit.model, LONG),
        "diagnose": diagnosis_page(example_diagnosis(), [LONG]),
    }
    folder = tmp_path_factory.mktemp("reports")
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in pages}


@pytest.mark.parametrize("name", ["identify", "evaluate", "diagnose"])
def test_a_report_fits_every_screen_and_can_be_read(name, reports, browser: Browser):
    for width in SIZES:
        for dark in (False, True):
            browser.open(reports[name], width, dark)
            folded = browser.value("document.querySelectorAll('details:not([open]) table').length")
            assert folded >= 2, "tables are folded"
            browser.unfold()
            assert browser.overflow() <= 0, (width, dark)
            assert browser.pale_texts() == [], (width, dark)
            assert browser.errors == [], (width, dark)


def test_a_printed_report_is_light_and_hides_nothing(reports, browser: Browser):
    for report in reports.values():
        browser.open(report, 700, dark=True, medium="print")
        heights = browser.value("[...document.querySelectorAll('table')].map(e => e.offsetHeight)")
        assert min(heights) > 0
        ground = browser.value("getComputedStyle(document.body).backgroundColor")
        assert ground == "rgb(255, 255, 255)"


def test_pictures_come_before_tables_and_the_arm_before_both(reports, browser: Browser):
    for report in reports.values():
        browser.open(report, 800)
        order = browser.value(
            "[...document.querySelectorAll('h1, svg, img, table')].map(e => e.tagName)"
        )
        assert [order[0], order[1], order[2]] == ["H1", "svg", "IMG"]


def test_the_checks_see_what_is_too_broad_too_pale_or_broken(tmp_path, browser: Browser):
    page = tmp_path / "bad.html"
    page.write_text(
        "<body style='background:#fff'><p style='color:#999;width:2000px'>pale</p>"
        "<script>missing()</script></body>"
    )
    browser.open(page, 360)
    assert browser.overflow() > 0
    assert [text.split(":")[0] for text in browser.pale_texts()] == ["pale"]
    assert len(browser.errors) == 1
