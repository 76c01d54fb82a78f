"""A document as an answer: its own script may run, and nothing may be loaded."""

from base64 import b64encode
from hashlib import sha256

from fastapi.responses import HTMLResponse

from app.analysis.document import Subject, document

_SCRIPT = '<script type="module">'
_POLICY = (
    "default-src 'none'; script-src {}; style-src 'unsafe-inline'; font-src data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


def document_response(subject: Subject, language: str) -> HTMLResponse:
    """Return a report, a black box or a reaction test as one HTML file.

    Raises:
        NotBuilt: the front end was not built.
    """
    page = document(subject, language)
    script = page.partition(_SCRIPT)[2].partition("</script>")[0]
    allowed = f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'"
    return HTMLResponse(page, headers={"Content-Security-Policy": _POLICY.format(allowed)})
