"""Asks the service on this machine how it is: the container's health check.

Exit status 0 while something comes from the battery and gets onto the disk, else 1 with the reasons.
"""

import json
import os
import ssl
import sys
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

TIMEOUT_S = 4.0


def ask(port: int) -> dict[str, Any]:
    """Return what the service on this port of the loopback says of itself, by HTTP or HTTPS.

    Raises:
        OSError: it does not answer, or not as ours does.
    """
    certificate_unread = ssl.create_default_context()  # it is this very machine; the name in it is another
    certificate_unread.check_hostname = False
    certificate_unread.verify_mode = ssl.CERT_NONE
    direct = urllib.request.build_opener(
        urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=certificate_unread)
    )
    error: OSError = OSError("no answer")
    for scheme in ("http", "https"):
        try:
            with direct.open(f"{scheme}://127.0.0.1:{port}/api/v1/health", timeout=TIMEOUT_S) as answer:
                document = json.load(answer)
                return document if isinstance(document, dict) else {}
        except (OSError, ValueError) as failure:
            error = failure if isinstance(failure, OSError) else OSError(str(failure))
    raise error


def main(environment: Mapping[str, str] = os.environ) -> int:
    """Print what is missing and return the exit status."""
    try:
        document = ask(int(environment.get("VOLTWALL_PORT", "8000")))
    except OSError as error:
        sys.stdout.write(f"the service does not respond: {error}\n")
        return 1
    reasons = document.get("reasons") or ["nothing is missing"]
    sys.stdout.write(f"{document.get('status')}: {'; '.join(map(str, reasons))}\n")
    return 0 if document.get("status") in ("ok", "degraded") else 1


if __name__ == "__main__":
    sys.exit(main())
