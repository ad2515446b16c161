"""What this machine is and what it allows: processor, packages, caches, scheduling, buses."""

from __future__ import annotations

import os
import platform
import resource
import time
from importlib import metadata
from pathlib import Path

import numpy as np

from preshape.hal.kernel_cache import cache_root
from preshape.tools.vcan_host import kernel_has_can

_CALM_S = 0.3
_NAP_S = 0.002


def packages() -> dict[str, str]:
    """Return the version of preshape and of every package it needs, "missing" where it is not installed."""
    versions = {"preshape": metadata.version("preshape")}
    for requirement in metadata.requires("preshape") or ():
        if "extra ==" in requirement:
            continue
        name = requirement.split(";")[0].strip().split(">")[0].split("=")[0].split("<")[0].split("[")[0].strip()
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "missing"
    return versions


def machine() -> dict[str, str]:
    """Return facts about the machine, in words."""
    return {
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "processor": _processor(),
        "cores": f"{len(os.sched_getaffinity(0))} usable of {os.cpu_count()}",
        "memory": f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB",
        "real-time priority": _real_time(),
        "sleep lateness": "p50 {:.0f} us, p99 {:.0f} us".format(*sleep_lateness_us()),
        "CAN sockets": "yes"
        if kernel_has_can()
        else "none in this kernel: use virtual, udp_multicast, or a guest (with_vcan)",
        "kernel cache": _kernel_cache(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def _real_time() -> str:
    """Return whether this process may ask for SCHED_FIFO, without asking."""
    if os.geteuid() == 0:
        return "allowed (root)"
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    return f"allowed up to {limit}" if limit else "not allowed: raise rtprio in /etc/security/limits.conf"


def _kernel_cache() -> str:
    root = cache_root()
    if root is None:
        return "none: no home directory, kernels are compiled in every process"
    if not root.is_dir():
        return f"{root}, still empty"
    files = [file for file in root.rglob("*.nbc")]
    size = sum(file.stat().st_size for file in files) / 2**20
    writable = "" if os.access(root, os.W_OK) else ", not writable: kernels are compiled in every process"
    return f"{root}, {len(files)} kernels, {size:.0f} MiB{writable}"


def sleep_lateness_us() -> tuple[float, float]:
    """Return median and 99th percentile of how much later than asked a sleep of 2 ms ends, us."""
    late: list[float] = []
    end = time.perf_counter() + _CALM_S
    while time.perf_counter() < end:
        start = time.perf_counter()
        time.sleep(_NAP_S)
        late.append((time.perf_counter() - start - _NAP_S) * 1e6)
    return float(np.percentile(late, 50)), float(np.percentile(late, 99))
