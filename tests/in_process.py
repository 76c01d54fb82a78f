"""Workers that are none: for tests that look at what is worked on, and not at where."""

from app.sessions.worker import Workers


class InProcess(Workers):
    """Runs a job where it is asked for."""

    def _run(self, job, on_progress=lambda: None, begin=None):
        function, arguments, named, _, tells = job
        return function(*arguments, **named, **({"on_progress": on_progress} if tells else {}))
