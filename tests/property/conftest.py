"""Property tests run on loaded machines too: the time of one example says nothing there."""

from hypothesis import HealthCheck, settings

settings.register_profile("voltwall", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("voltwall")
