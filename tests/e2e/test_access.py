"""With passwords set: nobody reads without one, a viewer reads and writes nothing, an engineer does both."""

import re

import pytest
from playwright.sync_api import expect

PASSWORDS = {"VOLTWALL_PASSWORD": "engineer-pass-1", "VOLTWALL_VIEWER_PASSWORD": "viewer-pass-1"}


@pytest.fixture(scope="module")
def guarded(make_module_service):
    return make_module_service(
        "--tls", "--seed", "7", VOLTWALL_PASSWORD="engineer-pass-1", VOLTWALL_VIEWER_PASSWORD="viewer-pass-1"
    )


def log_in(page, name: str, password: str) -> None:
    page.get_by_role("textbox", name="Name").fill(name)
    page.get_by_role("textbox", name="Password").fill(password)
    page.get_by_role("button", name="Log in").click()


def test_nothing_is_shown_before_the_login_and_a_viewer_cannot_write(guarded, open_page):
    page = open_page(f"{guarded.base_url}/#/parameters", quiet=False)
    expect(page.get_by_test_id("login")).to_be_visible()
    expect(page.get_by_test_id("param-v_cell_max")).to_have_count(0)
    log_in(page, "kari", "wrong")
    expect(page.get_by_role("alert").filter(has_text="Wrong name or password")).to_be_visible()
    log_in(page, "kari", "viewer-pass-1")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.2000")
    expect(page.get_by_test_id("user")).to_contain_text("viewer")
    expect(page.get_by_test_id("store")).to_be_disabled()
    expect(page.get_by_text("requires the engineer role")).to_be_visible()


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_the_login_page_is_for_everybody(guarded, open_page, violations, size):
    page = open_page(f"{guarded.base_url}/#/overview", size, quiet=False)
    expect(page.get_by_test_id("login")).to_be_visible()
    page.evaluate("new Promise((later) => setTimeout(later, 3000))")  # a silence that would be told
    expect(page.get_by_test_id("service-lost")).to_have_count(0)
    expect(page.get_by_test_id("state")).not_to_contain_text("does not answer")
    expect(page.get_by_test_id("login-reach")).to_contain_text("only works on this machine")
    assert violations(page) == {}
    expect(page.get_by_role("textbox", name="Name")).to_be_focused()
    page.keyboard.type("ola")
    page.keyboard.press("Tab")
    page.keyboard.type("engineer-pass-1")
    password, show = page.get_by_role("textbox", name="Password"), page.get_by_test_id("show-password")
    expect(password).to_have_attribute("type", "password")
    show.click()
    expect(password).to_have_attribute("type", "text")
    expect(password).to_have_value("engineer-pass-1")
    show.click()
    expect(password).to_have_attribute("type", "password")
    password.press("Enter")
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "live")


def test_an_engineer_may_write(guarded, open_page):
    page = open_page(f"{guarded.base_url}/#/parameters", quiet=False)
    log_in(page, "ola", "engineer-pass-1")
    expect(page.get_by_test_id("user")).to_contain_text("engineer")
    expect(page.get_by_test_id("store")).to_be_enabled()
    page.goto(f"{guarded.base_url}/#/system")
    printed = next(line for line in guarded.lines if "SHA-256" in line)
    expect(page.get_by_test_id("fingerprint")).to_have_text(printed.split()[-1])
    (cookie,) = page.context.cookies()
    assert cookie["secure"]
    assert cookie["httpOnly"]


def test_the_first_chief_is_made_on_the_page_and_adds_a_person(guarded, open_page):
    page = open_page(f"{guarded.base_url}/#/system", quiet=False)
    log_in(page, "ola", "engineer-pass-1")
    people = page.get_by_test_id("people")

    def add(name: str, password: str, button: str) -> None:
        people.get_by_role("textbox", name="Name", exact=True).fill(name)
        people.get_by_role("textbox", name="Password").fill(password)
        people.get_by_role("button", name=button).click()

    password, strength = people.get_by_role("textbox", name="Password"), people.get_by_test_id("password-strength")
    worth = {"short": "too short", "1234567890123": "weak:", "wet cats on every roof": "strong"}
    for typed, told in worth.items():
        password.fill(typed)
        expect(strength).to_contain_text(told)
        expect(password).to_have_accessible_description(strength.inner_text())
    expect(people.get_by_role("meter", name="Password strength")).to_be_visible()
    add("cora", "chief-pass-1", "Create the first administrator")
    expect(people.get_by_role("button", name="Create the first administrator")).to_have_count(0)
    page.get_by_role("button", name="Log out", exact=True).last.click()
    log_in(page, "cora", "chief-pass-1")
    expect(page.get_by_test_id("user")).to_contain_text("admin")
    add("erik", "erik-password-1", "Add user")
    expect(page.get_by_test_id("accounts")).to_contain_text("erik, viewer")
    expect(page.get_by_test_id("logins")).to_contain_text("this page")
    people.get_by_role("textbox", name="Program").fill("grafana")
    people.get_by_role("button", name="Create read-only API token").click()
    expect(page.get_by_test_id("secret")).to_contain_text("vw_")


def test_two_engineers_and_a_viewer_work_at_once(make_service, open_page):
    service = make_service("--seed", "7", "--scenario", "in-the-pit", **PASSWORDS)
    people = {}
    for name, password in (("ada", "engineer-pass-1"), ("bob", "engineer-pass-1"), ("eve", "viewer-pass-1")):
        people[name] = open_page(f"{service.base_url}/#/parameters", quiet=False)
        log_in(people[name], name, password)
        expect(people[name].get_by_test_id("inforce-t_cell_max")).to_contain_text("45")
    ada, bob, eve = people.values()

    def write(page, name, value):
        page.get_by_role("textbox", name=name, exact=True).fill(value)
        page.get_by_test_id("write").click()
        page.get_by_test_id("confirm").click()
        expect(page.get_by_test_id("outcome")).to_contain_text("Written and verified")

    bob.get_by_role("textbox", name="fan_ramp_stop", exact=True).fill("43")
    write(ada, "t_cell_max", "44")
    for page in (bob, eve):
        expect(page.get_by_test_id("inforce-t_cell_max")).to_contain_text("44")
    expect(bob.get_by_test_id("draft-state")).to_have_text("1 value changed")
    write(bob, "fan_ramp_stop", "43")
    for page in (ada, eve):
        expect(page.get_by_test_id("inforce-fan_ramp_stop")).to_contain_text("43")
        expect(page.get_by_test_id("inforce-t_cell_max")).to_contain_text("44")
    for button in ("check", "write", "store"):
        expect(eve.get_by_test_id(button)).to_be_disabled()
    eve.get_by_test_id("tab-history").click()
    history = eve.get_by_test_id("history")
    for who in ("ada", "bob"):
        expect(history).to_contain_text(who)
    expect(history.get_by_role("button", name="Roll back").first).to_be_disabled()


def test_an_administrator_allows_phones_and_gets_the_address_with_its_code(make_service, open_page):
    service = make_service("--seed", "7")
    page = open_page(f"{service.base_url}/#/system", quiet=False)
    expect(page.get_by_test_id("reach-needs")).to_contain_text("Password: missing")
    expect(page.get_by_test_id("phones-on")).to_be_disabled()
    people = page.get_by_test_id("people")
    people.get_by_role("textbox", name="Name").fill("anna")
    people.get_by_role("textbox", name="Password").fill("a long enough password")
    people.get_by_role("button", name="Create the first administrator").click()
    expect(page.get_by_test_id("login")).to_be_visible()
    log_in(page, "anna", "a long enough password")
    expect(page.get_by_test_id("reach-needs")).to_contain_text("Password: set")
    page.get_by_test_id("phones-on").click()
    expect(page.get_by_test_id("fingerprint")).to_have_text(re.compile(r"^([0-9A-F]{2}:){31}[0-9A-F]{2}$"))
    expect(page.get_by_test_id("reach-url")).to_have_text(re.compile(r"^https://[\d.]+:\d+/$"))
    expect(page.get_by_test_id("qr")).to_be_visible()
    address = page.get_by_test_id("reach-url").inner_text()
    phone = open_page(address, "phone", quiet=False)
    log_in(phone, "anna", "a long enough password")
    expect(phone.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"of 96"))
    page.get_by_test_id("phones-off").click()
    expect(page.get_by_test_id("reach-needs")).to_be_visible()
    expect(phone.get_by_test_id("service-lost")).to_be_visible()
