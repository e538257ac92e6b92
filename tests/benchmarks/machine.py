"""What the benchmarks ran on, and with."""

import os
import platform
import subprocess
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch
from measure import limit

PACKAGES = ("affmap", "torch", "numpy", "lightning", "gymnasium")
PEERS = ("pytorch-icem", "torchrl", "mbrl", "evotorch", "stable-worldmodel")


def describe() -> dict[str, Any]:
    """Plain values; memory in GiB, the matrix product in 10^9 floating-point operations a second."""
    return {
        "date": time.strftime("%Y-%m-%d"),
        "system": f"{platform.system()} {platform.release()}",
        "processor": processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "card": card(),
        "threads": torch.get_num_threads(),
        "matrix_product_gflop_per_second": round(limit() / 1e9, 1),
        "versions": {"python": platform.python_version(), **{name: found(name) for name in PACKAGES + PEERS}},
    }


def found(package: str) -> str | None:
    """Its version; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def processor() -> str:
    """Its name, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def card() -> dict[str, Any] | None:
    """The first card that torch can use: name, memory in GiB, versions of CUDA and driver; None where there is none."""
    if not torch.cuda.is_available():
        return None
    properties = torch.cuda.get_device_properties(0)
    memory = round(properties.total_memory / 2**30, 1)
    return {"name": properties.name, "memory_gib": memory, "cuda": torch.version.cuda, "driver": driver()}


def driver() -> str | None:
    """Version of the driver of NVIDIA's cards; None where nothing tells it."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader", "--id=0"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=30).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
