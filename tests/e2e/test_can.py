"""CAN as part of the configuration: bytes picked by name, written, received."""

import re

import pytest
from playwright.sync_api import expect

DBC = """\
BO_ 513 Dash: 4 BMS
 SG_ soc : 7|16@0+ (0.0001,0) [0|1] "" ECU
 SG_ rpm : 16|16@1+ (1,0) [0|1] "" ECU
BA_ "GenMsgCycleTime" BO_ 513 20;
"""


@pytest.fixture(scope="module")
def scenario():
    return "in-the-pit"


def test_a_message_is_put_together_by_name_and_written(service, open_page):
    page = open_page(f"{service.base_url}/#/can", quiet=False)
    message = page.get_by_test_id("can-tx-3")
    expect(page.get_by_test_id("can-tx-2")).to_be_visible()
    expect(message).to_have_count(0)
    page.get_by_role("button", name="Show 5 unused messages").click()
    message.get_by_role("button").first.click()
    message.get_by_label("ID (hex)").fill("1A0")
    message.get_by_label("Period, ms").fill("200")
    message.get_by_test_id("picker").fill("v_tot")
    message.get_by_role("button", name="v_tot").first.click()
    message.get_by_test_id("picker").fill("t_max_id")
    message.get_by_role("button", name="t_max_id").first.click()
    message.get_by_label("enabled at start-up").check()
    expect(message).to_contain_text("v_tot")
    page.get_by_role("button", name="Discard").click()
    expect(message).not_to_contain_text("v_tot")
    page.get_by_test_id("undo").get_by_role("button", name="Undo").click()
    expect(message).to_contain_text("v_tot")
    page.get_by_test_id("can-write").click()
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("can-outcome")).to_contain_text("written and verified")
    with service.client() as client:
        sent = client.get("/can").json()["tx"][3]
    assert (sent["id"], sent["period_ms"], sent["length"], sent["bytes"][:3]) == (0x1A0, 200, 3, [2288, 2289, 2390])


def test_the_monitor_shows_the_summary_that_the_master_sends_decoded(service, open_page):
    page = open_page(f"{service.base_url}/#/can")
    page.get_by_test_id("tab-trace").click()
    expect(page).to_have_url(re.compile("#/can/trace$"))
    page.go_back()
    expect(page.get_by_test_id("tab-tx")).to_have_attribute("aria-pressed", "true")
    page.go_forward()
    row = page.get_by_test_id("bus-0x100")
    expect(row).to_contain_text("master")
    row.get_by_role("button").click()
    expect(page.get_by_test_id("trace")).to_contain_text("v_tot")
    expect(page.get_by_test_id("bus-0x18FF50E5")).to_contain_text("never received")
    page.get_by_role("searchbox").fill("charger")
    expect(row).to_have_count(0)


def test_a_dbc_becomes_a_message_of_the_table(service, open_page, tmp_path):
    file = tmp_path / "dash.dbc"
    file.write_text(DBC)
    page = open_page(f"{service.base_url}/#/can")
    page.get_by_label("master node").fill("BMS")
    page.get_by_test_id("dbc-file").set_input_files(file)
    expect(page.get_by_test_id("dbc-notes")).to_contain_text("Dash.rpm: no value of the master's has this name")
    expect(page.get_by_text("0x201")).to_be_visible()
    page.get_by_test_id("can-write").click()
    expect(page.get_by_test_id("write-dialog")).to_contain_text("can_tx_msg_id")
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("can-outcome")).to_contain_text("written and verified")
    with service.client() as client:
        dash = next(m for m in client.get("/can").json()["tx"] if m["id"] == 513)
    assert (dash["period_ms"], dash["bytes"][:2]) == (20, [2983, 2982])


def test_two_messages_with_one_id_are_refused(service, open_page):
    page = open_page(f"{service.base_url}/#/can", quiet=False)
    page.get_by_test_id("can-unused").click()
    message = page.get_by_test_id("can-tx-6")
    message.get_by_role("button").first.click()
    message.get_by_label("ID (hex)").fill("100")
    message.get_by_test_id("picker").fill("t_max_id")
    message.get_by_role("button", name="t_max_id").first.click()
    page.get_by_test_id("can-write").click()
    expect(page.get_by_text("two senders of one ID corrupt each other")).to_be_visible()
    expect(page.get_by_test_id("write-dialog")).to_have_count(0)


def test_a_charger_is_played_by_hand(service, open_page):
    page = open_page(f"{service.base_url}/#/can")
    page.get_by_test_id("tab-send").click()
    panel = page.get_by_test_id("transmit")
    panel.get_by_label("ID (hex)").fill("18FF50E5")
    panel.get_by_label("29-bit").check()
    panel.get_by_label("Bytes (hex)").fill("0E 74 00 00 00 00 00 00")
    panel.get_by_label("Period, ms").fill("200")
    panel.get_by_role("button", name="Send list").click()
    expect(panel.get_by_role("status")).to_contain_text("Sending list of 1")
    service.wait_for(lambda s: s["charger"]["voltage_v"] == 370.0)
    panel.get_by_role("button", name="Stop").click()
    expect(panel.get_by_role("status")).to_contain_text("Sent list of 1")


def test_the_master_sends_a_message_once_and_from_now_on(service, open_page):
    page = open_page(f"{service.base_url}/#/can")
    row = page.get_by_test_id("can-tx-2")
    row.get_by_role("button", expanded=False).click()
    now = page.get_by_test_id("send-now-2")
    expect(now).to_contain_text("Not sent by the master")
    with service.client() as client:

        def received() -> int:
            return {i["id"]: i["count"] for i in client.get("/can/bus").json()["ids"]}[0x101]

        before = received()
        now.get_by_test_id("command-can-send").click()
        page.get_by_test_id("confirm").click()
        expect(now).to_contain_text("done")
        service.wait_for(lambda _: received() == before + 1)
    now.get_by_test_id("command-can-tx-enable").click()
    page.get_by_test_id("confirm").click()
    expect(now).to_contain_text("Sent by the master")
    now.get_by_test_id("command-can-tx-enable").click()
    page.get_by_test_id("confirm").click()
    expect(now).to_contain_text("Not sent by the master")
