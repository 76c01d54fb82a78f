import pytest

from app.errors import ConfigError
from app.live.pipeline_factory import PipelineFactory


@pytest.mark.parametrize(("names", "field"), [(("kalman", "lco-pouch"), "filter"), (("fused", "lead-acid"), "cell")])
def test_a_name_that_stands_for_nothing_is_named(names, field):
    with pytest.raises(ConfigError) as caught:
        PipelineFactory(*names)
    assert caught.value.field == field


def test_its_pipelines_say_what_estimates_and_share_nothing(master):
    chain = PipelineFactory("coulomb", "samsung-25r-10p")
    one, other = chain.pipeline("serial", "port"), chain.pipeline("replay", "recorded")
    snapshot = one.feed(master.frame()).snapshot
    assert (snapshot.estimator.filter, snapshot.estimator.cell) == ("coulomb", "samsung-25r-10p")
    assert one.estimates is not None
    assert other.estimates is None
