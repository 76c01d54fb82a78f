"""CAN as part of the configuration: bytes picked by name, written, heard."""

from playwright.sync_api import expect


def test_a_message_is_put_together_by_name_and_written(service, open_page):
    page = open_page(f"{service.base_url}/#/can", quiet=False)
    message = page.get_by_test_id("can-tx-3")
    message.get_by_role("button").first.click()
    message.get_by_label("Id (hex)").fill("1A0")
    message.get_by_label("Period, ms").fill("200")
    message.get_by_test_id("picker").fill("v_tot")
    message.get_by_role("button", name="v_tot").first.click()
    message.get_by_test_id("picker").fill("t_max_id")
    message.get_by_role("button", name="t_max_id").first.click()
    message.get_by_label("on from start").check()
    expect(message).to_contain_text("v_tot")
    page.get_by_test_id("can-write").click()
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("can-outcome")).to_contain_text("written and read back")
    with service.client() as client:
        sent = client.get("/can").json()["tx"][3]
    assert (sent["id"], sent["period_ms"], sent["length"], sent["bytes"][:3]) == (0x1A0, 200, 3, [2288, 2289, 2390])


def test_the_bus_trace_shows_the_summary_that_the_master_sends(service, open_page):
    page = open_page(f"{service.base_url}/#/can", quiet=False)
    page.get_by_test_id("tab-trace").click()
    expect(page.get_by_test_id("trace")).to_contain_text("0x100")
