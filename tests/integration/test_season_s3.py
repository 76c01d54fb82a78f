"""A season lake behind the S3 protocol, on moto's server: built, asked and brought up to date as in a folder.

Runs in `make campaign` alone, where `moto[server]` and `s3fs` are installed.
"""

import pytest

from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.store import SeasonStore
from app.season.store.questions import ask
from tests.campaign import SIZE, campaign, report_figure
from tests.recorded.season import make_season

pytestmark = [campaign(60, 120, 120), pytest.mark.skipif(SIZE == "sample", reason="in the campaign")]
LAKE = "s3://season/lake"


@pytest.fixture
def bucket(monkeypatch):
    """An empty bucket `season` of a server on loopback, which fsspec finds by the environment."""
    server_of = pytest.importorskip("moto.server", reason="pip install moto[server] s3fs")
    fs_of = pytest.importorskip("s3fs", reason="pip install moto[server] s3fs")
    server = server_of.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    known = {"ENDPOINT_URL": f"http://{host}:{port}", "ACCESS_KEY_ID": "key", "SECRET_ACCESS_KEY": "secret"}
    for name, value in known.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    fs_of.S3FileSystem.clear_instance_cache()
    fs = fs_of.S3FileSystem()
    fs.makedirs("season", exist_ok=True)  # the server keeps what it has from one test to the next
    yield fs
    fs.rm("season", recursive=True)
    server.stop()
    fs_of.S3FileSystem.clear_instance_cache()


def test_a_lake_on_s3_answers_as_one_in_a_folder(bucket, tmp_path):
    sessions = session_files([make_season(tmp_path / "sessions")])
    build_lake(LakeFolder(tmp_path / "lake"), sessions)
    assert len(build_lake(LakeFolder(LAKE), sessions).made) == 2
    local, remote = SeasonStore(tmp_path / "lake"), SeasonStore(LAKE)
    for question, given in (("lowest_voltage", {}), ("resistance", {}), ("signal", {"signal": "v[36]"})):
        there, here = (ask(store, question, **given).rows() for store in (remote, local))
        assert there == here
        assert here
    objects = bucket.find("season/lake")
    report_figure(f"season lake on S3: {len(objects)} objects, three questions as in a folder")


def test_on_s3_only_what_has_changed_is_built_again(bucket, tmp_path):
    sessions = session_files([make_season(tmp_path / "sessions")])
    build_lake(LakeFolder(LAKE), sessions)
    assert len(build_lake(LakeFolder(LAKE), sessions).current) == 2
    sessions[0].touch()
    again = build_lake(LakeFolder(LAKE), sessions)
    assert (again.made, again.current) == ([sessions[0].stem], [sessions[1].stem])
    bucket.pipe(next(name for name in bucket.find("season/lake") if name.endswith("sessions.parquet")), b"damaged")
    assert len(build_lake(LakeFolder(LAKE), sessions).made) == 1
    assert ask(SeasonStore(LAKE), "resistance").rows()
