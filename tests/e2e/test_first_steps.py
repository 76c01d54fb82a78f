"""A service that was never told what to read: its page asks, and what is chosen stays."""

from playwright.sync_api import expect

from tests.service_process import Service


def test_the_first_page_asks_and_the_choice_takes_effect(tmp_path, open_page):
    service = Service(tmp_path, []).start()
    try:
        page = open_page(service.base_url + "/", quiet=False)  # the connection is lost while it starts again
        expect(page.get_by_role("heading", name="What shall Voltwall read?")).to_be_visible()
        page.get_by_test_id("how-serial").check()
        page.get_by_test_id("setup-serial").fill("/dev/ttyUSB77")
        page.get_by_test_id("setup-test").click()
        expect(page.get_by_test_id("setup-look")).to_contain_text("no such port")
        expect(page.get_by_test_id("setup-look")).to_contain_text("COM6 on Windows")
        page.get_by_label("example, one signal a cell, 90 cells").check()
        page.get_by_test_id("how-simulate").check()
        page.get_by_test_id("setup-start").click()
        expect(page).to_have_url(service.base_url + "/#/overview")
        expect(page.get_by_test_id("loaded-cells")).to_contain_text("of 90")
        again = open_page(service.base_url + "/", quiet=False)
        expect(again.get_by_test_id("loaded-cells")).to_contain_text("of 90")
    finally:
        service.stop()
