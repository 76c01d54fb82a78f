"""The command palette: by keys on a desktop and by touch on a phone to any page, cell, session, parameter or action."""

import re

import pytest
from playwright.sync_api import expect


@pytest.fixture(scope="module")
def car(make_module_service):
    """A service that records, with an alarm that nobody has seen."""
    service = make_module_service("--seed", "8")
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 60)
    with service.client() as client:
        client.post("/simulator/faults", json={"fault": "sense-wire-open", "pack": 3, "cell": 7}).raise_for_status()
    service.wait_for(lambda s: s["alarms"])
    return service


@pytest.fixture
def session(car):
    """The name under which the running session is listed."""
    with car.client() as client:
        (found,) = client.get("/sessions").json()["sessions"]
    return found["name"] or found["id"]


def typed(page, words, *, opens_with="Control+k"):
    """Open the palette and type."""
    expect(page.get_by_test_id("palette")).to_have_count(0)  # while it closes, the same keys only close it
    page.keyboard.press(opens_with)
    field = page.get_by_role("combobox", name="Find a page")
    expect(field).to_be_focused()
    page.keyboard.type(words)
    return field


def chosen(page):
    """The entry that Enter takes, as a screen reader is told."""
    return page.get_by_test_id("palette").get_by_role("option", selected=True)


def test_keys_lead_to_cells_pages_sessions_and_parameters(car, session, open_page):
    page = open_page(f"{car.base_url}/#/overview")
    expect(page.get_by_test_id("heatmap")).to_be_visible()
    heading = page.get_by_role("heading", level=1)
    for words, title in (
        ("p3 c7", "pack 3, cell 7"),
        ("cell 31", "pack 3, cell 7"),
        ("black boxes", "Black boxes"),
    ):
        typed(page, words, opens_with="/")
        page.keyboard.press("Enter")
        expect(heading).to_have_text(title)
        expect(page.get_by_test_id("palette")).to_have_count(0)

    typed(page, session)
    expect(chosen(page)).to_contain_text(session)  # the list of sessions has arrived
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile("#/sessions/.+"))

    typed(page, "max cell v_")
    expect(chosen(page)).to_contain_text("v_cell_max")
    page.keyboard.press("Enter")
    expect(page.get_by_label("Find parameter")).to_have_value("v_cell_max")
    expect(page.get_by_test_id("param-v_cell_max")).to_be_visible()
    expect(page.get_by_test_id("param-t_cell_max")).to_have_count(0)


def test_the_words_of_a_task_lead_to_its_page(car, open_page):
    page = open_page(f"{car.base_url}/#/overview")
    expect(page.get_by_test_id("heatmap")).to_be_visible()
    typed(page, "")
    field = page.get_by_role("combobox", name="Find a page")
    options = page.get_by_test_id("palette").get_by_role("option")
    for word, title in (
        ("motec", "Sessions"),
        ("export", "Sessions"),
        ("phone", "System"),
        ("dbc", "CAN"),
        ("weakest", "Overview"),
    ):
        field.fill(word)
        expect(options.filter(has_text=title).first).to_be_visible()


def test_it_is_walked_by_arrows_and_left_as_it_was_found(car, open_page, violations):
    page = open_page(f"{car.base_url}/#/events")
    word = page.get_by_label("Filter by text")
    word.fill("3")
    word.press("/")  # in a field it is a letter
    expect(word).to_have_value("3/")
    field = typed(page, "")  # from a field too
    options = page.get_by_test_id("palette").get_by_role("option")
    expect(options.first).to_have_attribute("aria-selected", "true")
    expect(options.first).to_contain_text(re.compile("Overview.*1"))  # with its own key
    page.keyboard.press("ArrowUp")
    expect(options.last).to_have_attribute("aria-selected", "true")
    expect(options.last).to_be_in_viewport()
    page.keyboard.press("ArrowDown")
    expect(options.first).to_have_attribute("aria-selected", "true")
    assert violations(page) == {}
    field.fill("no such thing")
    expect(page.get_by_role("status").filter(has_text="No match")).to_be_visible()
    expect(options).to_have_count(0)
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("palette")).to_have_count(0)
    expect(word).to_be_focused()
    expect(word).to_have_value("3/")


def test_a_viewer_is_offered_nothing_that_writes(car, open_page):
    page = open_page(f"{car.base_url}/#/overview")
    viewer = {"role": "viewer", "name": "v", "password_required": True, "has_chief": False}
    page.route("**/api/v1/me", lambda route: route.fulfill(json=viewer))
    page.reload()
    expect(page.get_by_test_id("user")).to_contain_text("viewer")
    typed(page, "")
    options = page.get_by_test_id("palette").get_by_role("option")
    expect(options.filter(has_text="Overview")).to_be_visible()
    for writes in ("Mark a lap", "Mark this moment", "Acknowledge all alarms"):
        expect(options.filter(has_text=writes)).to_have_count(0)


def test_a_lap_is_marked_all_alarms_are_acknowledged_and_a_language_is_chosen_and_searched(car, open_page):
    page = open_page(f"{car.base_url}/#/overview")
    expect(page.get_by_test_id("recording")).to_contain_text("REC")
    typed(page, "lap mark")
    expect(chosen(page)).to_contain_text("Mark a lap")  # who is here is known
    page.keyboard.press("Enter")
    mark = page.get_by_test_id("mark")
    expect(mark.get_by_role("button", name="Lap")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Enter")
    expect(mark).to_have_count(0)
    with car.client() as client:
        shown = {alarm["id"] for alarm in client.get("/snapshot").json()["alarms"]}
    typed(page, "all alarms")
    expect(chosen(page)).to_contain_text("Acknowledge all alarms")
    page.keyboard.press("Enter")
    expect(page.get_by_test_id("palette")).to_have_count(0)
    car.wait_for(lambda s: all(a["acknowledged_by"] for a in s["alarms"] if a["id"] in shown))  # more may come

    typed(page, "norsk")
    page.keyboard.press("Enter")
    expect(page.locator("html")).to_have_attribute("lang", "nb")
    heading = page.get_by_role("heading", level=1)
    for words, title in (("okter", "Økter"), ("pakke 3 celle 7", "pakke 3, celle 7"), ("events", "Hendelser")):
        page.keyboard.press("Control+k")
        page.get_by_test_id("palette").get_by_role("combobox").fill(words)
        page.keyboard.press("Enter")
        expect(heading).to_have_text(title)


def test_on_a_phone_it_is_behind_more(car, open_page, violations):
    page = open_page(f"{car.base_url}/#/overview", "phone")
    page.get_by_role("button", name="More").tap()
    page.get_by_role("navigation").get_by_role("button", name="Find").tap()
    field = page.get_by_test_id("palette").get_by_role("combobox")
    expect(field).to_be_focused()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    heights = (
        page.get_by_test_id("palette")
        .get_by_role("option")
        .evaluate_all("(all) => all.map((each) => each.getBoundingClientRect().height)")
    )
    assert min(heights) >= 44
    assert violations(page) == {}
    field.fill("3 7")
    page.get_by_role("option", name="pack 3, cell 7").tap()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
    expect(page.get_by_test_id("palette")).to_have_count(0)
