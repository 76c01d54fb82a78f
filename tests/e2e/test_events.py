"""The event log: from what happened to the moment at which it did."""

import re

from playwright.sync_api import expect


def test_one_click_leads_from_an_event_to_its_moment(make_service, open_page):
    service = make_service("--seed", "8")
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 60)
    with service.client() as client:
        client.post("/simulator/faults", json={"fault": "sense-wire-open", "pack": 3, "cell": 7}).raise_for_status()
    service.wait_for(lambda s: any(a["cell"] is not None for a in s["alarms"]))
    for size in ("desktop", "phone"):
        page = open_page(f"{service.base_url}/#/events", size)
        row = page.get_by_test_id("events").get_by_role("row", name=re.compile("trip .*pack 3, cell [78]")).first
        row.get_by_role("link", name=re.compile("Go to recording at")).click()
        expect(page.get_by_test_id("readout")).to_be_visible()
        expect(page.get_by_text(re.compile("Voltage of pack 3, cell [78]")).first).to_be_visible()
        page.close()
