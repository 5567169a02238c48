"""The page of a fleet in a browser: of fifty arms and of five thousand."""

from __future__ import annotations

import numpy as np
import pytest
from browser import CHROMIUM, NAMES, chromium

from dvrk_gravity.fleet import ArmHistory, Series, Visit, assess_changes, with_fit
from dvrk_gravity.report import arm_page, history_csv, history_page, history_text

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason=f"no browser to look with: none of {', '.join(NAMES)} is installed"
)
RATE = 0.05
HOSTILE = "</script><b>1"  # as a serial number


def fleet_of(count: int) -> list[ArmHistory]:
    """Return arms of which every fiftieth has friction that grows, and the others vary."""
    random, arms = np.random.default_rng(0), []
    for number in range(count):
        day = 19_723.0 + np.sort(random.uniform(0.0, 730.0, 24))
        error = random.uniform(0.002, 0.006, 24)
        series = []
        for effect in ("coulomb_friction", "viscous_friction", "torque_offset", "torque_scale"):
            value = random.standard_normal(24) * np.hypot(error, 0.02)
            series.append(Series(effect, "pitch", "positive", "N·m", 1.5, day, value, error))
        p_value = 1.0
        if number % 50 == 0:
            first = series[0]
            grown = first.value + 0.002 * np.maximum(day - 20_100.0, 0.0)
            series[0] = with_fit(Series(*first.name, "N·m", 1.5, day, grown, error))
            p_value = min(1.0, len(series) * series[0].fitted.p_value)
        visits = tuple(
            Visit(each, "explained", f"{number}.csv", f"reports/{number}-{k}.html", "friction")
            for k, each in enumerate(day.tolist())
        )
        serial = HOSTILE if number == 1 else f"{20_000 + number}"
        arms.append(ArmHistory(serial, "ecm", visits, tuple(series), p_value))
    return assess_changes(arms)


@pytest.mark.parametrize("count", [50, 5000])
def test_a_page_shows_the_worst_first_finds_an_arm_and_fits_a_phone(count, tmp_path):
    arms = fleet_of(count)
    changed = [arm for arm in arms if arm.changes]
    assert len(changed) == count // 50
    path = tmp_path / "history.html"
    path.write_text(history_page(arms, RATE, {arms[0].serial: "arms/1.html"}), encoding="utf-8")
    shown = "[...document.querySelectorAll('.unit h2')].map(e => e.firstChild.textContent)"
    with chromium(tmp_path / "profile") as browser:
        for width in (360, 1200):
            browser.open(path, width)
            assert browser.errors == []
            assert browser.overflow() <= 0
            assert browser.value(f"{shown}[0]") == arms[0].serial
            # As many as one looks at, however many there are.
            assert browser.value(f"{shown}.length") == 30
        assert browser.value("document.querySelectorAll('b').length") == 0
        for text, found in ((HOSTILE[3:9], 1), ("20049", 1), ("a month", len(changed))):
            browser.value(f"search.value = {text!r}; search.oninput()")
            words = f"{found} of {count} arms"
            assert browser.value("document.getElementById('count').textContent") == words
            assert browser.value(f"{shown}.length") == min(found, 30)
        link = "document.querySelector('.multiples a').getAttribute('href')"
        assert str(browser.value(link)).startswith("reports/")


def test_an_arm_s_page_leads_to_its_reports_and_summaries_have_every_change(tmp_path):
    arms = fleet_of(100)
    page = arm_page(arms[0], RATE)
    assert page.count('href="../reports/') == 24
    assert "Coulomb friction of pitch" in page
    rows = history_csv(arms).splitlines()
    assert len(rows) == 1 + sum(len(arm.changes) for arm in arms)
    assert history_text(arms)[0].startswith("2 of 100 arms changed")
