"""Every report as a browser shows it: on a phone, a laptop and a wide screen, light and dark."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import CHROMIUM, NAMES, Browser, chromium
from made_results import TIME, example_diagnosis, fit_of

from dvrk_gravity.calibration import Certificate, JointCertificate, MotionTally
from dvrk_gravity.identification import Evaluation
from dvrk_gravity.report import (
    certificate_page,
    diagnosis_page,
    evaluation_page,
    identification_page,
)

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason=f"no browser to look with: none of {', '.join(NAMES)} is installed"
)

SIZES = (360, 800, 1600)  # px: a phone, half a screen, a whole one
LONG = "a_recording_with_a_name_that_has_no_place_to_break_" * 2 + ".csv"


POINTS, INCH = 8, 130  # of the smallest text in a picture; pixels of a picture in an inch


def certificate_of(arm) -> Certificate:
    joints = tuple(
        JointCertificate(
            name, "N·m", "rad", 0.0123, (0.01, 0.02), 0.1, "good", 0.003, (0.02, 0.01, 0.03),
            -1.0, 1.0, 0.004, 0.02,
        )
        for name in arm.joint_names
    )  # fmt: skip
    return Certificate(
        arm.name, "/MTMR", "an arm", "2026-01-01", {"numpy": "2"}, (), "certified", joints, 20, 0.2,
        5.0, 1.0, 20, 0.05, 0.1, MotionTally(120.0, 0.0, 120000, 0.93, LONG), (LONG,), (LONG,),
        {LONG: "0" * 64}, LONG,
    )  # fmt: skip


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
        "calibrate": certificate_page(certificate_of(fit.model.arm), evaluation, fit.model.arm),
    }
    folder = tmp_path_factory.mktemp("reports")
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in pages}


@pytest.mark.parametrize("name", ["identify", "evaluate", "diagnose", "calibrate"])
def test_a_report_fits_every_screen_and_can_be_read(name, reports, browser: Browser):
    for width in SIZES:
        for dark in (False, True):
            browser.open(reports[name], width, dark)
            folded = browser.value("document.querySelectorAll('details:not([open]) table').length")
            assert folded >= 2 - (name == "calibrate"), "tables are folded"
            browser.unfold()
            assert browser.overflow() <= 0, (width, dark)
            assert browser.pale_texts() == [], (width, dark)
            assert browser.errors == [], (width, dark)
            outside, text = browser.value(
                "[...document.images].reduce(([right, px], e) => ["
                "Math.max(right, e.getBoundingClientRect().right - innerWidth),"
                f"Math.min(px, e.width / e.naturalWidth * {INCH} / 72 * {POINTS})], [-1, 99])"
            )
            assert outside <= 0, "a picture is cropped"
            assert text >= 8.0, "text in pictures is too small, px"


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
