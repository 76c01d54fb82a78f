"""A live part on a clock that the test turns: items are worked on in the test's own thread."""

from dataclasses import dataclass, field, replace

import pytest

from app.live.hub import Hub
from app.live.pipeline import Output
from app.live.pipeline_factory import PipelineFactory
from app.service.inbox import Inbox
from app.service.pipeline_thread import PipelineThread
from app.sources.items import Item
from tests.fake_clock import FakeClock


@dataclass
class FakeReplay:
    """Whether a replay is shown."""

    is_active: bool = False


@dataclass
class LiveBench:
    """A live part, what it hangs on, and what its listeners were given."""

    clock: FakeClock
    pipeline: object
    inbox: Inbox = field(default_factory=Inbox)
    replay: FakeReplay = field(default_factory=FakeReplay)
    items: list[Item] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)
    live: PipelineThread = field(init=False)

    def __post_init__(self) -> None:
        self.live = PipelineThread(
            self.pipeline,
            self.inbox,
            Hub(),
            self.replay,
            self.clock,
            on_item=(self.items.append,),
            on_output=(lambda output, t_mono_ns: self.outputs.append(output),),
        )

    def feed(self, *items: Item) -> None:
        """Let items arrive now, and be worked on."""
        for item in items:
            self.inbox.put(replace(item, t_mono_ns=self.clock.monotonic_ns(), t_wall_ns=self.clock.wall_ns()))
            self.live.step(0.0)


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def bench(clock) -> LiveBench:
    return LiveBench(clock, PipelineFactory("coulomb").pipeline("serial", "loop://"))
