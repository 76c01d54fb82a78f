"""A TypeScript client that openapi-typescript makes of the OpenAPI document is strict, and works against a service.

openapi-typescript wants TypeScript 5, the front end has a later one: both are fetched into a folder of their own.
"""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.campaign import SIZE

pytestmark = [
    pytest.mark.timeout(600),  # it fetches, generates and compiles
    pytest.mark.skipif(SIZE == "sample", reason="half a minute, and the network: make campaign"),
    pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed"),
]
PASSWORD = "three words of ours"
PACKAGES = ("openapi-typescript@7.13.0", "openapi-fetch@0.17.0", "typescript@5.9.3")
PROGRAM = """\
import createClient from 'openapi-fetch'
import type { paths } from './api.js'

function found<T>(answer: { data?: T; error?: unknown }): T {
  if (answer.data === undefined) throw new Error(JSON.stringify(answer.error))
  return answer.data
}

const Authorization = `Basic ${btoa('Anna:' + PASSWORD)}`
const client = createClient<paths>({ baseUrl: ADDRESS, headers: { Authorization } })
const ids: string[] = []
for (const name of ['first', 'second', 'third']) {
  const recording = found(await client.POST('/api/v1/sessions', { body: { name } }))
  const params = { path: { session_id: recording.id } }
  found(await client.POST('/api/v1/sessions/{session_id}/markers', { params, body: { text: '', kind: 'lap' } }))
  if (name !== 'third') found(await client.POST('/api/v1/sessions/{session_id}/stop', { params }))
  ids.unshift(recording.id)
}
const first = found(await client.GET('/api/v1/sessions', { params: { query: { limit: 2 } } }))
const query = { limit: 2, cursor: first.next_cursor ?? '' }
const rest = found(await client.GET('/api/v1/sessions', { params: { query } }))
const path = { session_id: ids[0] ?? '' }
const marks = found(await client.GET('/api/v1/sessions/{session_id}/markers', { params: { path } }))
const snapshot = found(await client.GET('/api/v1/snapshot'))
const missing = await client.GET('/api/v1/sessions/{session_id}', { params: { path: { session_id: 'none' } } })
// @ts-expect-error the types know the names of values
const misspelt: unknown = snapshot.cells.voltage
console.log(
  JSON.stringify({
    me: found(await client.GET('/api/v1/me')).name,
    ids,
    pages: [first, rest].map((page) => page.sessions.map((each) => each.id)),
    marks: marks.markers.map((each) => [each.kind, each.who]),
    cells: snapshot.cells.voltage_v.length,
    missing: missing.response.status,
    misspelt: misspelt ?? null,
  }),
)
"""


def run(folder: Path, *command: str) -> str:
    """Return what a command in the folder printed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """A folder with the generator and the compiler."""
    (tmp_path / "package.json").write_text('{"private": true, "type": "module"}')
    fetch = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *PACKAGES]
    done = subprocess.run(fetch, cwd=tmp_path, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"npm fetches nothing here: {done.stderr[-200:]}")
    return tmp_path


def test_it_is_strict_and_marks_a_lap_lists_by_pages_and_reads_a_snapshot(make_service, packages: Path) -> None:
    service = make_service("--seed", "1", "--no-record", VOLTWALL_PASSWORD=PASSWORD)
    with service.client(auth=("Anna", PASSWORD)) as plain:
        (packages / "openapi.json").write_bytes(plain.get("/openapi.json").content)
    programs = packages / "node_modules" / ".bin"
    with_defaults = "--default-non-nullable=false"  # a field of a request that has a default may be left out
    run(packages, str(programs / "openapi-typescript"), "openapi.json", with_defaults, "-o", "api.ts")
    constants = f"const ADDRESS = {json.dumps(service.base_url)}\nconst PASSWORD = {json.dumps(PASSWORD)}\n"
    (packages / "client.ts").write_text(PROGRAM.replace("\n\n", f"\n\n{constants}\n", 1))
    options = ("--strict", "--skipLibCheck", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom")
    run(packages, str(programs / "tsc"), *options, "client.ts")
    told = json.loads(run(packages, "node", "client.js"))
    assert told["me"] == "Anna"
    assert told["pages"] == [told["ids"][:2], told["ids"][2:]]
    assert told["marks"] == [["lap", "Anna"]]
    assert (told["cells"], told["missing"], told["misspelt"]) == (96, 404, None)
