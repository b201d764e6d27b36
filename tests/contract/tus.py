"""Recordings as one file, sent by two tus clients that are not ours: tus-js-client and tuspy."""

import pathlib
import subprocess
import tarfile
import time
import zipfile

from tusclient.client import TusClient

SCRIPT = pathlib.Path(__file__).with_name("tus_client.cjs")


def with_node(service, rope, path):
    """Sends a file with tus-js-client (found over NODE_PATH), interrupted once; returns its address."""
    done = subprocess.run(
        ["node", SCRIPT, f"{service.url}/api/v1/tus", service.token, rope, path], capture_output=True, text=True, timeout=120
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return done.stdout.strip()


def with_python(service, rope, path):
    """Sends a file with tuspy, with checksums and interrupted once; returns its address."""
    client = TusClient(f"{service.url}/api/v1/tus", headers={"Authorization": f"Bearer {service.token}"})
    chunk = path.stat().st_size // 7 + 1
    options = {"chunk_size": chunk, "upload_checksum": True, "metadata": {"filename": path.name, "rope_id": rope}}
    first = client.uploader(str(path), **options)
    first.upload_chunk()
    first.upload_chunk()
    again = client.uploader(str(path), url=first.url, **options)
    if again.offset != 2 * chunk:
        raise RuntimeError(f"it goes on at {again.offset}, not at {2 * chunk}")
    again.upload()
    return again.url


def checks(service, rope, folder):
    """Yields (name, ok, what was seen)."""
    tar, zipped = service.folder / "rope.tar", service.folder / "rope.zip"
    with tarfile.open(tar, "w") as archive:
        archive.add(folder, "rope")
    with zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            archive.write(path, path.relative_to(folder.parent))
    frames = len(list(folder.glob("view*/frame_*")))
    for name, send, path in [("tus-js-client", with_node, tar), ("tuspy", with_python, zipped)]:
        try:
            place = send(service, rope, path).split("/api/v1", 1)[1].replace("/tus/", "/archives/")
            archive = service.want("GET", place)
            while archive["state"] == "unpacking":
                time.sleep(0.2)
                archive = service.want("GET", place)
            taken = archive["state"] == "unpacked"
            there = service.want("GET", f"/acquisitions/{archive['acquisition_id']}") if taken else archive
            yield f"{name}: {path.name} arrives and is unpacked", taken and there["frames_present"] == frames, str(there)[:500]
        except Exception as error:
            yield f"{name}: {path.name} arrives and is unpacked", False, repr(error)[:2000]
