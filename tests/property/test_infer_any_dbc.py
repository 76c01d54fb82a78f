"""Learning takes any DBC and any frames: a suggestion that can be read again, or none."""

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from app.battery.profile import read_document, understand
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.check import issues_of
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.inference import infer_profile
from app.sources.dbc.infer.profile_text import profile_text
from tests.campaign import examples

WORDS = [
    "Cell", "V", "Volt", "Voltage", "Temp", "T", "NTC", "Seg", "Module", "ic", "group", "id", "num", "Current", "Pack",
    "SOC", "A", "B", "1", "2", "03", "12", "_", "_", "Min", "start", "Sum",
]  # fmt: skip
UNITS = ["", "V", "mV", "A", "C", "degC", "°C", "%", "0.1mV"]


@st.composite
def any_dbc(draw):
    lines = ['VERSION ""\nNS_ :\nBS_:\nBU_: X\n']
    for m in range(draw(st.integers(1, 6))):
        name = "".join(draw(st.lists(st.sampled_from(WORDS), min_size=1, max_size=4)))
        lines.append(f"BO_ {draw(st.integers(1, 40)) + 40 * m} {name}: 8 X")
        is_muxed = draw(st.booleans())
        if is_muxed:
            lines.append(f' SG_ {draw(st.sampled_from(["Mux", "id", "group_id"]))} M : 0|4@1+ (1,0) [0|0] "" X')
        stem = draw(st.lists(st.sampled_from(WORDS), min_size=1, max_size=3))
        for k in range(draw(st.integers(1, 6))):
            mux = f" m{draw(st.integers(0, 3))}" if is_muxed and draw(st.booleans()) else ""
            signal = "".join(stem) + (str(k) if draw(st.booleans()) else draw(st.sampled_from(WORDS)))
            start, length = draw(st.integers(0, 32)), draw(st.sampled_from([1, 4, 8, 12, 16]))
            factor = draw(st.sampled_from(["1", "0.001", "0.1", "0.0001"]))
            lines.append(
                f' SG_ {signal}{mux} : {start}|{length}@1+ ({factor},0) [0|0] "{draw(st.sampled_from(UNITS))}" X'
            )
    return "\n".join(lines) + "\n"


@settings(max_examples=examples(60), deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
@given(any_dbc(), st.data())
def test_learning_never_fails_and_its_suggestions_can_be_used(text, data):
    definitions = parse_definitions(text.encode(), "any.dbc")
    ids = [message.can_id for message in definitions.messages]
    random = data.draw(st.randoms(use_true_random=False))
    frames = frames_of(
        [(t * 10**8, random.choice(ids), random.randbytes(8)) for t in range(data.draw(st.integers(0, 80)))]
    )
    inferred = infer_profile(survey_bus(definitions, frames), frames, "any", ("any.dbc",))
    if inferred is None:
        return
    profile = understand(read_document(profile_text(inferred), "any.toml", lambda name: None))
    BatteryDecoder(profile.battery, profile.source, definitions).decode(frames)
    issues_of(profile.battery, profile.source, definitions, "any.toml", frames)
