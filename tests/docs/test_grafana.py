"""The dashboard shows what the service measures: every metric in it exists, with the labels that it filters by."""

import json
import re
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

ROOT = Path(__file__).resolve().parents[2]
DASHBOARD = json.loads((ROOT / "docs/grafana/voltwall.json").read_text(encoding="utf-8"))
HOWTO = (ROOT / "docs/howto/publish.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def measured(service) -> dict[str, set[str]]:
    """Every sample's name with its labels, of a service on the simulated car."""
    service.wait_for(
        lambda s: s["accumulator"]["soc"] is not None and s["recording"] and s["master"]["fit"] is not None
    )
    service.wait_for(lambda s: s["cells"]["resistance_ohm"][0] is not None)
    with service.client() as client:
        text = client.get(service.base_url + "/metrics").text
    found: dict[str, set[str]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, set()).update(sample.labels)
    return found


def expressions() -> list[str]:
    queries = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
    queries += [each["query"]["query"] for each in DASHBOARD["templating"]["list"] if each["type"] == "query"]
    return queries + re.findall(r"^\| `([^`]+)` \|", HOWTO, re.MULTILINE)


def test_every_metric_of_the_dashboard_is_measured_with_its_labels(measured):
    assert len(expressions()) > 35
    for expression in expressions():
        for name, labels in re.findall(r"(voltwall_\w+)(?:\{([^}]*)\})?", expression):
            assert name in measured, expression
            wanted = set(re.findall(r"(\w+)\s*=~?", labels)) - {"instance"}
            assert wanted <= measured[name], expression
        for name, label in re.findall(r"label_values\((\w+), (\w+)\)", expression):
            assert label in measured[name] | {"instance"}


def test_every_legend_names_labels_that_there_are(measured):
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            (name, *_) = re.findall(r"voltwall_\w+", target["expr"])
            assert set(re.findall(r"\{\{(\w+)\}\}", target["legendFormat"])) <= measured[name], panel["title"]


def test_panels_have_their_own_place_and_number():
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells = [
        (x, y)
        for at in (panel["gridPos"] for panel in panels)
        for x in range(at["x"], at["x"] + at["w"])
        for y in range(at["y"], at["y"] + at["h"])
    ]
    assert len(cells) == len(set(cells))
    assert max(x for x, _ in cells) == 23
