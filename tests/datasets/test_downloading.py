import gzip
import hashlib
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from datasets import downloading
from datasets.downloading import DownloadError, download, known_recording, known_recordings
from datasets.errors import DatasetError

CONTENT = b"#ROSBAG V2.0\n" + bytes(range(256)) * 4000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


class Handler(BaseHTTPRequestHandler):
    """A server with the faults that servers have, chosen by the test."""

    def do_GET(self):
        server = self.server
        server.asked.append(dict(self.headers))
        if server.status:
            self.send_error(server.status)
            return
        wanted = re.match(r"bytes=(\d+)-", self.headers.get("Range", ""))
        start = int(wanted[1]) if wanted and server.ranges and self.headers.get("If-Range") in (None, server.tag) else 0
        if start and start >= len(server.content):
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{len(server.content)}")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(server.content) - 1}/{len(server.content)}")
        for length in server.lengths or [str(len(server.content) - start)]:
            self.send_header("Content-Length", length)
        if server.packing:
            self.send_header("Content-Encoding", server.packing)
        self.send_header("ETag", server.tag)
        self.end_headers()
        data = server.content[start:]
        if server.cuts:
            data = data[: server.cuts.pop(0)]
        self.wfile.write(data)
        self.close_connection = True

    def log_message(self, *_):
        pass


@pytest.fixture
def server():
    made = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    made.content, made.tag, made.ranges, made.status, made.cuts, made.asked = CONTENT, '"one"', True, None, [], []
    made.lengths, made.packing = [], None
    thread = threading.Thread(target=made.serve_forever)
    thread.start()
    made.address = f"http://127.0.0.1:{made.server_port}/a.bag"
    yield made
    made.shutdown()
    thread.join()
    made.server_close()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_arrives_with_its_digest(server, tmp_path):
    told = []
    assert download(server.address, tmp_path / "new" / "a.bag", SHA256, lambda *far: told.append(far)) is True
    assert (tmp_path / "new" / "a.bag").read_bytes() == CONTENT
    assert names(tmp_path / "new") == ["a.bag", "a.bag.sha256"]
    assert (tmp_path / "new" / "a.bag.sha256").read_text() == f"{SHA256}  a.bag\n"
    assert told[-1] == (len(CONTENT), len(CONTENT))


def test_what_is_there_is_checked_and_not_fetched_again(server, tmp_path):
    target = tmp_path / "a.bag"
    download(server.address, target)
    assert download(server.address, target) is False
    assert len(server.asked) == 1
    target.write_bytes(b"other")
    with pytest.raises(DownloadError, match=r"a\.bag: is not the file that was downloaded: remove it to download it"):
        download(server.address, target)


def test_a_broken_connection_is_taken_up_again(server, tmp_path):
    server.cuts = [5 << 16, 3 << 16]
    assert download(server.address, tmp_path / "a.bag", SHA256) is True
    assert [asked.get("Range") for asked in server.asked] == [None, f"bytes={5 << 16}-", f"bytes={8 << 16}-"]


def test_a_later_run_continues(server, tmp_path):
    server.cuts = [1 << 16] * 3
    with pytest.raises(DownloadError, match=r"the connection failed after 196608 bytes .*: check the network and run"):
        download(server.address, tmp_path / "a.bag", SHA256)
    assert names(tmp_path) == ["a.bag.part", "a.bag.part.tag"]
    download(server.address, tmp_path / "a.bag", SHA256)
    assert server.asked[-1]["Range"] == "bytes=196608-"
    assert names(tmp_path) == ["a.bag", "a.bag.sha256"]


@pytest.mark.parametrize("change", [{"ranges": False}, {"tag": '"two"'}])
def test_the_download_restarts_if_the_server_cannot_resume(server, tmp_path, change):
    server.cuts = [1 << 16] * 3
    with pytest.raises(DownloadError):
        download(server.address, tmp_path / "a.bag")
    vars(server).update(change)
    assert download(server.address, tmp_path / "a.bag", SHA256) is True


def test_a_restart_that_is_killed_leaves_no_part_of_the_older_file(server, tmp_path, monkeypatch):
    server.cuts = [1 << 16] * 3
    with pytest.raises(DownloadError):
        download(server.address, tmp_path / "a.bag")
    write_text = downloading.write_text

    def write_and_be_killed(*words):
        write_text(*words)
        raise KeyboardInterrupt

    server.tag, server.content = '"two"', CONTENT[::-1]
    monkeypatch.setattr(downloading, "write_text", write_and_be_killed)
    with pytest.raises(KeyboardInterrupt):
        download(server.address, tmp_path / "a.bag")
    assert names(tmp_path) == ["a.bag.part.tag"]


def test_everything_had_arrived_before_it_broke_off(server, tmp_path):
    (tmp_path / "a.bag.part").write_bytes(CONTENT)
    assert download(server.address, tmp_path / "a.bag", SHA256) is True


def test_more_than_everything_is_thrown_away(server, tmp_path):
    (tmp_path / "a.bag.part").write_bytes(CONTENT + b"x")
    with pytest.raises(DownloadError, match="416"):
        download(server.address, tmp_path / "a.bag", SHA256)
    assert download(server.address, tmp_path / "a.bag", SHA256) is True


@pytest.mark.parametrize("lengths", [["abc"], ["-5"], ["12", "13"], ["\u0663"]])
def test_an_invalid_length_is_reported(server, tmp_path, lengths):
    server.lengths = [length.encode().decode("latin-1") for length in lengths]
    with pytest.raises(DownloadError, match=r"states an unreadable length|cannot be requested"):
        download(server.address, tmp_path / "a.bag")
    assert not (tmp_path / "a.bag").exists()


def test_a_length_stated_twice_is_one_length(server, tmp_path):
    server.lengths = [str(len(CONTENT))] * 2
    assert download(server.address, tmp_path / "a.bag", SHA256) is True


def test_a_packed_body_is_refused(server, tmp_path):
    server.content, server.packing = gzip.compress(bytes(10_000_000)), "gzip"
    with pytest.raises(DownloadError, match="comes packed as gzip, which was not requested"):
        download(server.address, tmp_path / "a.bag")
    assert not (tmp_path / "a.bag").exists()


def test_a_body_without_an_end_is_cut(server, tmp_path, monkeypatch):
    server.lengths = [""]
    monkeypatch.setattr(downloading, "_LARGEST", 500_000)
    with pytest.raises(DownloadError, match="more than 500000 bytes arrived"):
        download(server.address, tmp_path / "a.bag")
    assert names(tmp_path) in ([], ["a.bag.part.tag"])


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.bag", b"", "is empty"),
        ("a.bag", b"\n<!DOCTYPE html><html>please log in", "is a web page"),
        ("a.relations", b"<html>moved", "is a web page"),
        ("a.bag", b"moved to another server", r"does not begin as a \.bag file"),
        ("a.png", b"no picture", r"does not begin as a \.png file"),
        ("a.bag.gz", b"#ROSBAG V2.0", r"does not begin as a \.gz file"),
    ],
)
def test_what_cannot_be_the_file_is_not_kept(server, tmp_path, name, content, why):
    server.content = content
    with pytest.raises(DownloadError, match=rf"the received file {why}: it was removed"):
        download(server.address, tmp_path / name)
    assert names(tmp_path) == []
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DownloadError, match=rf"{why}: remove it to download it again"):
        download(server.address, tmp_path / name)


def test_a_416_where_nothing_had_begun_is_what_the_server_says(server, tmp_path):
    server.status = 416
    with pytest.raises(DownloadError, match="the server says 416"):
        download(server.address, tmp_path / "a.bag")
    assert names(tmp_path) == []


def test_a_wrong_digest_is_not_kept(server, tmp_path):
    with pytest.raises(DownloadError, match=rf"the received file has the SHA-256 {SHA256}, not 0+: it was removed"):
        download(server.address, tmp_path / "a.bag", "0" * 64)
    assert not (tmp_path / "a.bag").exists()
    assert not (tmp_path / "a.bag.part").exists()


@pytest.mark.parametrize("status", [404, 403, 500])
def test_a_server_that_refuses(server, tmp_path, status):
    server.status = status
    with pytest.raises(DownloadError, match=rf"a\.bag: the server says {status} .+: check if it has moved"):
        download(server.address, tmp_path / "a.bag")
    assert names(tmp_path) == []


def test_no_server_and_no_address(tmp_path):
    with pytest.raises(DownloadError, match=r"the connection failed after 0 bytes \(ConnectionError\)"):
        download("http://127.0.0.1:1/a.bag", tmp_path / "a.bag")
    with pytest.raises(DownloadError, match=r"cannot be requested .*: check the address"):
        download("nowhere", tmp_path / "a.bag")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
def test_a_full_disk_is_reported_with_the_file(server, tmp_path):
    (tmp_path / "a.bag.part").symlink_to("/dev/full")
    with pytest.raises(DownloadError, match=r"a\.bag\.part: cannot be written \(No space left on device\): make room"):
        download(server.address, tmp_path / "a.bag")


def test_each_recording_has_an_address_and_a_licence():
    known = known_recordings()
    assert {"stata/2011-01-24-06-18-27", "freiburg/intel"} <= known.keys()
    addresses = [address for recording in known.values() for address in recording.addresses]
    assert len(set(addresses)) == len(addresses)
    for recording in known.values():
        assert all(address.startswith("http") for address in recording.addresses)
        assert all((recording.license, recording.citation, recording.page, recording.about))


def test_the_profile_of_a_recording_is_given():
    assert known_recording("stata/2011-01-24-06-18-27").options == "--profile stata"


@pytest.mark.parametrize(
    ("name", "meant"),
    [("stata/2011-01-24-06-18-72", "did you mean stata/2011-01-24"), ("intel", "freiburg/intel"), ("x", "--list")],
)
def test_an_unknown_name(name, meant):
    with pytest.raises(DatasetError, match=rf"there is no known recording '{name}': .*{meant}"):
        known_recording(name)
