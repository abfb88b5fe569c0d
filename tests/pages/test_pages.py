"""Every page of the site in a browser without a network: no error, no missing picture, no formula left unset."""

import re

import pytest


pytestmark = pytest.mark.slow

FIRST_PAGE = 1_000_000  # bytes, with all that it loads


def test_pages_open_without_a_fault(site, address, browser):
    pages = sorted(page.relative_to(site).parent.as_posix() for page in site.rglob("index.html"))
    assert len(pages) > 40
    faults = {}
    for page in pages:
        visit = browser.visit(f"{address}/{page}/".replace("/./", "/"))
        elsewhere = [url for url in visit.asked if not url.startswith(address)]
        found = [*visit.errors, *visit.pictures, *visit.formulas, *elsewhere]
        if found:
            faults[page] = found
    assert not faults


def test_first_page_is_light(address, browser):
    visit = browser.visit(f"{address}/")
    assert 50_000 < visit.bytes < FIRST_PAGE, [visit.bytes, visit.asked]


def test_faults_are_seen(tmp_path, browser):
    page = tmp_path / "page.html"
    page.write_text(
        '<img src="missing.png"><span class="arithmatex">\\(x\\)</span>'
        '<script>console.error("one"); throw new Error("two")</script>'
    )
    visit = browser.visit(page.as_uri())
    assert [re.sub(".*/", "", each) for each in visit.pictures] == ["missing.png"]
    assert visit.formulas == ["\\(x\\)"]
    errors = " ".join(visit.errors)
    assert "one" in errors and "two" in errors and "ERR_FILE_NOT_FOUND" in errors
