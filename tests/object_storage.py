"""A study from and to an object storage: a minute of the sample on an S3 server of this machine.

python tests/object_storage.py MOTO_SERVER FOLDER

The folder of the run holds the configuration alone; Snakemake fetches the recording from the
server, and brings the results there. They must have the bytes of a run without it. Part of `make
test-cluster`; needs `pip install snakemake-storage-plugin-s3 'moto[server]'`.
"""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import boto3
from botocore.exceptions import EndpointConnectionError

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "workflow"))

from checkouts import part_of_sample  # noqa: E402 -- its folder is not a package

CONFIG = """
study: short
recordings: [{name: hopper, file: data/short.h5}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3], boom: [boom]}
prediction: {bootstraps: 20, train: 30, test: 10, minimum_class: 15}
distances: {enabled: false}
verdict: {flips: 99}
figures: {formats: [svg]}
"""
WANTED = "results/short/verdict.json"
COMPARED = [
    WANTED,
    "results/short/tables/touchdowns.csv",
    "results/short/contacts/hopper.csv",
]


def snakemake(folder, *options):
    environment = os.environ | {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}
    command = [sys.executable, "-m", "snakemake", "--cores", "2"]
    command += ["--snakefile", ROOT / "Snakefile", "--configfile", "config/short.yaml"]
    run = subprocess.run(
        [*map(str, command), *options, "--", WANTED],
        cwd=folder, env=environment, capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    if run.returncode:
        raise SystemExit(
            f"{folder}: expected a study that ends, found:\n{run.stderr[-3000:]}"
        )


def prepared(folder):
    (folder / "config").mkdir(parents=True)
    (folder / "config" / "short.yaml").write_text(CONFIG, encoding="utf-8")
    return folder


def with_bucket(address):
    """Return a client of the server, once it answers, with an empty bucket."""
    client = boto3.client(
        "s3", endpoint_url=address, region_name="us-east-1",
        aws_access_key_id="a", aws_secret_access_key="b",
    )  # fmt: skip
    for _ in range(120):
        try:
            client.create_bucket(Bucket="lab")
        except EndpointConnectionError:
            time.sleep(0.5)
        else:
            return client
    raise SystemExit("the S3 server does not answer")


def main(moto, place):
    local = prepared(Path(place) / "local")
    part_of_sample(local / "data" / "short.h5", 60)
    snakemake(local)
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    server = subprocess.Popen(
        [moto, "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        address = f"http://127.0.0.1:{port}"
        client = with_bucket(address)
        client.upload_file(str(local / "data" / "short.h5"), "lab", "data/short.h5")
        far = prepared(Path(place) / "far")
        snakemake(
            far, "--default-storage-provider", "s3", "--default-storage-prefix", "s3://lab",
            "--storage-s3-endpoint-url", address, "--storage-s3-region", "us-east-1",
            "--storage-s3-access-key", "a", "--storage-s3-secret-key", "b",
        )  # fmt: skip
        for name in COMPARED:
            kept = client.get_object(Bucket="lab", Key=name)["Body"].read()
            if kept != (local / name).read_bytes():
                raise SystemExit(f"s3://lab/{name}: expected the bytes of a local run")
        if (far / "data").exists():
            raise SystemExit(f"{far}: expected no recording beside the configuration")
    finally:
        server.kill()
        server.wait()
    print(
        "test-cluster: from and to an S3 server, the bytes of a local run",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
