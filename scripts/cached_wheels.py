"""Gives pip without a network the wheels that its cache has: cached_wheels.py CACHE LOCK FOLDER links them into FOLDER.

Pip keeps what it has downloaded, but asks the index for names and versions each time. Here a wheel is known by its
sha256 in the lock file, and named by what it says of itself.
"""

import email
import hashlib
import os
import re
import sys
import zipfile
from pathlib import Path


def name_of(wheel: Path) -> str:
    """Return the file name of a wheel, from its metadata: NAME-VERSION-PYTHONS-ABIS-PLATFORMS.whl."""
    with zipfile.ZipFile(wheel) as content:
        member = next(name for name in content.namelist() if re.fullmatch(r"[^/]+\.dist-info/WHEEL", name))
        tags = email.message_from_bytes(content.read(member)).get_all("Tag", [])
    parts = [".".join(dict.fromkeys(words)) for words in zip(*(tag.split("-") for tag in tags), strict=True)]
    return "-".join([member.partition(".dist-info")[0], *parts]) + ".whl"


def link_wheels(cache: Path, lock: Path, folder: Path) -> int:
    """Link into a folder what a cache of pip (23.3 or later) has of a lock file; return how many wheels these are."""
    wanted, found = set(re.findall(r"sha256:(\w{64})", lock.read_text())), 0
    folder.mkdir(parents=True, exist_ok=True)
    for body in sorted((cache / "http-v2").rglob("*.body")):
        with body.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() not in wanted or not zipfile.is_zipfile(body):
                continue
        (folder / name_of(body)).unlink(missing_ok=True)
        os.symlink(body, folder / name_of(body))
        found += 1
    return found


if __name__ == "__main__":
    sys.exit(not link_wheels(*map(Path, sys.argv[1:])))
