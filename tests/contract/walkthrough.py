"""The walk with curl in docs/upload.md, as it stands there: what users copy has to work."""

import os
import pathlib
import re
import struct
import subprocess
import uuid
import zlib

DOCUMENT = pathlib.Path(__file__).parents[2] / "docs" / "upload.md"
SENSOR_PX, LINES, REDUCTION = 480, 2000, 4


def blocks():
    """The shell blocks of the protocol, in order."""
    protocol = DOCUMENT.read_text().split("## The protocol")[1]
    return re.findall(r"^```sh\n(.*?)^```", protocol, re.S | re.M)


def png(width, height):
    """A gray image."""
    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    lines = zlib.compress((b"\0" + bytes([96]) * width) * height)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", lines) + chunk(b"IEND", b"")


def second_frame(block):
    """The same for the second frame."""
    return block.replace("000000", "000001").replace('"frame": 0', '"frame": 1').replace("frames/0", "frames/1")


def script(url):
    """All blocks as one program, in an order in which every one can be seen to work."""
    put, announce, previews, send, missing, complete, receipt, live, dump = blocks()
    begin, rest = re.match(r"(job=.*?\n)(?=curl)(.*)", live, re.S).groups()
    events = next(line for line in rest.splitlines() if "/events" in line)
    while_it_runs = "\n".join(line for line in rest.splitlines() if line != events)
    until_signed = f"for try in $(seq 200); do\n{receipt}echo; sleep 0.05\ndone | grep -m 1 signature > receipt.json"
    parts = [put, announce, second_frame(announce), begin, previews, send, second_frame(send), missing, while_it_runs, complete,
             f"echo; {events}", until_signed, dump, "echo; echo acquisition $acquisition archive ${place##*/}"]
    return "set -eu\n" + "\n".join(parts).replace("https://ropes.example", url)


def folder_of(service, frames):
    """What the laptop has: two frames, a preview, a dump and its rope.json; and the programs that it calls."""
    folder = service.folder / "walk"
    folder.mkdir()
    for number in range(2):
        (folder / f"frame_{number:06}.png").write_bytes((frames / "view0" / f"frame_{number:06}.png").read_bytes())
    (folder / "preview_000000.png").write_bytes(png(SENSOR_PX // REDUCTION, LINES // REDUCTION))
    (folder / "rope.json").write_bytes((frames / "rope.json").read_bytes())
    (folder / "all.raw").write_bytes(bytes([96]) * SENSOR_PX * 100)
    # A refusal shall end the walk, which curl does not do by itself; and not every system has uuidgen.
    (folder / ".curlrc").write_text("fail-with-body\nsilent\nshow-error\n")
    uuidgen = folder / "uuidgen"
    uuidgen.write_text(f"#!/bin/sh\necho {uuid.uuid4()}\n")
    uuidgen.chmod(0o755)
    return folder


def checks(service, ids):
    """Yields (name, ok, what was seen)."""
    folder = folder_of(service, ids["folder"])
    given = {"api": f"{service.url}/api/v1", "auth": f"Authorization: Bearer {service.token}", "rope": ids["rope"], "model": ids["model"]}
    path = f"{folder}:{os.environ['PATH']}"
    walk = subprocess.run(["bash", "-c", script(service.url)], cwd=folder, capture_output=True, text=True, timeout=300,
                          env={**os.environ, **given, "PATH": path, "CURL_HOME": str(folder)})
    yield "curl: every step succeeds", walk.returncode == 0, f"{walk.stdout[-2000:]} {walk.stderr[-2000:]}"
    if walk.returncode:
        return
    yield "curl: events are told to the end", "event: end" in walk.stdout, walk.stdout[-2000:]
    acquisition, archive = re.search(r"^acquisition (\S+) archive (\S+)$", walk.stdout, re.M).groups()
    state = service.want("GET", f"/acquisitions/{acquisition}")["state"]
    yield "curl: the acquisition is complete", state == "complete", state
    yield "curl: the receipt is signed", "signature" in (folder / "receipt.json").read_text(), "it is not"
    state = service.want("GET", f"/archives/{archive}")
    yield "curl: the dump arrived whole", state["state"] in ("unpacking", "unpacked"), state
