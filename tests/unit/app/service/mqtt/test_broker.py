"""Which broker a URL names, and under which topics a car publishes."""

import pytest

from app.errors import ConfigError
from app.service.mqtt.broker import parse_broker


def test_a_url_names_host_port_prefix_and_user():
    broker = parse_broker("mqtts://pit%40team@car.local/fsg/", password="secret")
    assert (broker.host, broker.port, broker.prefix, broker.uses_tls) == ("car.local", 8883, "fsg", True)
    assert (broker.user, broker.password) == ("pit@team", "secret")
    assert str(broker) == "mqtts://car.local:8883/fsg"


def test_without_port_and_prefix_there_are_defaults():
    broker = parse_broker("mqtt://pit")
    assert (broker.port, broker.prefix, broker.uses_tls, broker.user) == (1883, "voltwall", False, None)


def test_a_ca_that_is_no_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="mqtt_ca"):
        parse_broker("mqtts://pit", ca=tmp_path / "none.pem")


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("http://pit", "mqtt.s.://"),
        ("mqtt://", "mqtt.s.://"),
        ("mqtt://pit:99999999", "mqtt.s.://"),
        ("mqtt://a:b@pit", "VOLTWALL_MQTT_PASSWORD"),
        ("mqtt://pit/a/#", "mqtt.s.://"),
    ],
)
def test_what_is_no_broker_is_refused(url, reason):
    with pytest.raises(ConfigError, match=reason):
        parse_broker(url)


def test_a_car_of_several_has_topics_of_its_own():
    broker = parse_broker("mqtt://pit/fsg")
    assert broker.of_car(None) is broker
    assert broker.of_car("red-2").prefix == "fsg/red-2"


@pytest.mark.parametrize("name", ["", "a/b", "#", "+", "-x", "x" * 41, "bl\u00e5", "a b"])
def test_what_is_no_level_of_a_topic_is_no_name_of_a_car(name):
    with pytest.raises(ConfigError, match="car = "):
        parse_broker("mqtt://pit").of_car(name)
