"""What programs outside rely on. A name that is missing here breaks somebody's notebook: take none away."""

import dataclasses
import inspect

import voltwall

NAMES = {
    "Estimate": {"cell", "filter", "summary", "table", "to_arrow", "to_pandas", "to_polars"},
    "Event": {"cell", "code", "limit", "severity", "text", "time", "unit", "value"},
    "Finding": {"cell", "code", "confidence", "high", "low", "since", "size", "text", "unit"},
    "Lap": {
        *(
            "counts",
            "driver",
            "duration_s",
            "end",
            "energy_in_wh",
            "energy_out_wh",
            "is_partial",
            "number",
            "power_max_w",
        ),
        *("power_mean_w", "soc_used", "start", "temperature_max_cell", "temperature_max_degc", "voltage_min_v"),
        "weakest_cell",
    },
    "Live": {"latest", "url"},
    "Season": {"ask", "build", "cars", "close", "lake", "questions", "sql"},
    "Session": {
        *("close", "duration_s", "estimate", "events", "findings", "id", "laps", "metadata", "n_cells", "name"),
        *("segments", "signals", "start", "table", "to_arrow", "to_pandas", "to_polars"),
    },
    "Table": {"arrow", "rows", "to_arrow", "to_pandas", "to_polars", "units"},
}
FUNCTIONS = {
    "connect": ["url", "password", "name", "rate", "trust"],
    "open": ["where", "password", "trust"],
    "season": ["where"],
}
OF_INSTANCES = {"Live": {"url"}, "Season": {"lake"}}


def test_the_public_names_are_these() -> None:
    assert set(voltwall.__all__) == NAMES.keys() | FUNCTIONS.keys() | {"VoltwallError", "__version__"}


def test_every_class_has_its_public_attributes() -> None:
    for name, attributes in NAMES.items():
        of = getattr(voltwall, name)
        fields = {field.name for field in dataclasses.fields(of)} if dataclasses.is_dataclass(of) else set()
        found = {each for each in dir(of) if not each.startswith("_")} | fields | OF_INSTANCES.get(name, set())
        assert found == attributes, name


def test_every_function_has_its_parameters_and_everything_is_documented() -> None:
    for name, parameters in FUNCTIONS.items():
        assert list(inspect.signature(getattr(voltwall, name)).parameters) == parameters
    for name in voltwall.__all__:
        of = getattr(voltwall, name)
        assert name == "__version__" or inspect.getdoc(of)
        for each in NAMES.get(name, ()):
            attribute = inspect.getattr_static(of, each, None)
            if callable(attribute) or isinstance(attribute, property):
                assert inspect.getdoc(getattr(of, each)), f"{name}.{each}"
