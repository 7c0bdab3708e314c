"""Pages of a run's folder that all its processes map: doorbells, heartbeats, the supervisor, rings of messages.

Words that others change too are changed by the kernel: FUTEX_WAKE_OP adds atomically. Python has no atomics, and needs no
library for them here.
"""

import ctypes
import errno
import mmap
import os
import platform
import struct
import time

from .errors import HapficError

_SYS_FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine())
_FUTEX_WAKE_OP = 5
_FUTEX_WAIT_BITSET = 9
_libc = ctypes.CDLL(None, use_errno=True)
_libc.syscall.restype = ctypes.c_long


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def _map(root: str, name: str, size: int) -> mmap.mmap:
    """Maps a file of a run's folder; makes it if it is missing, and never shrinks it."""
    path = os.path.join(root, name)
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            if os.fstat(file).st_size < size:
                os.posix_fallocate(file, 0, size)
            return mmap.mmap(file, size)
        finally:
            os.close(file)
    except OSError as cause:
        raise HapficError(f"cannot map {path}: {cause}") from cause


def _add(word: ctypes.c_uint32, amount: int, wake: int = 0) -> None:
    """Adds to a word atomically, and wakes as many that wait for it."""
    # FUTEX_OP_ADD, FUTEX_OP_CMP_LT 0: the second wake-up never happens.
    operation = (1 << 28) | (2 << 24) | ((amount & 0xFFF) << 12)
    address = ctypes.c_void_p(ctypes.addressof(word))
    _libc.syscall(_SYS_FUTEX, address, _FUTEX_WAKE_OP, wake, ctypes.c_void_p(0), address, ctypes.c_uint32(operation))


class Doorbell:
    """A notifier of which a thread can wait for the next notification."""

    def __init__(self, page: mmap.mmap, number: int):
        self._sequence, self._waiters = (ctypes.c_uint32.from_buffer(page, 64 * number + 4 * word) for word in range(2))
        self._seen = self._sequence.value

    def notify(self) -> None:
        """Wakes all waiters."""
        _add(self._sequence, 1, 2**31 - 1)

    def wait(self, seconds: float) -> bool:
        """Waits for a notification since the last call, or for a time; returns whether one came."""
        if self._sequence.value == self._seen:
            due = time.monotonic_ns() + int(seconds * 1e9)
            until = _Timespec(due // 10**9, due % 10**9)
            _add(self._waiters, 1)
            try:
                address = ctypes.c_void_p(ctypes.addressof(self._sequence))
                _libc.syscall(
                    _SYS_FUTEX,
                    address,
                    _FUTEX_WAIT_BITSET,
                    ctypes.c_uint32(self._seen),
                    ctypes.byref(until),
                    ctypes.c_void_p(0),
                    ctypes.c_uint32(0xFFFFFFFF),
                )
                if ctypes.get_errno() == errno.ENOSYS:
                    time.sleep(min(seconds, 0.0005))
            finally:
                _add(self._waiters, -1)
        before, self._seen = self._seen, self._sequence.value
        return before != self._seen


class Doorbells:
    """All doorbells of a run."""

    def __init__(self, root: str):
        if _SYS_FUTEX is None:
            raise HapficError(f"found a {platform.machine()}, expected x86_64 or aarch64")
        self._page = _map(root, "doorbells", 16 * 64)

    def __getitem__(self, number: int) -> Doorbell:
        return Doorbell(self._page, number)


class Heartbeat:
    """The heartbeat of a process, which it writes itself."""

    _LINE = 128

    def __init__(self, root: str, process: int, generation: int):
        page = _map(root, "heartbeats", self._LINE * 9)
        self._base, self._page, self._tag = self._LINE * process, page, generation + 1
        self._version = ctypes.c_uint64.from_buffer(page, self._base + 8)

    def write(self, phase: int, tick: int, realtime: int = 0, rejected: int = 0) -> None:
        """Writes a phase and the last tick."""
        version = self._version.value + 1
        slot = self._base + 16 + 40 * (version % 2)
        words = (self._tag, time.monotonic_ns(), phase | realtime << 32, tick & 0xFFFFFFFFFFFFFFFF, rejected)
        struct.pack_into("=5Q", self._page, slot, *words)
        self._version.value = version


class Ring:
    """The last messages of a sender, which outlive it."""

    def __init__(self, root: str, topic: str, sender: str, kind: type[ctypes.Structure], capacity: int):
        self._kind, self._size, self._capacity = kind, ctypes.sizeof(kind), capacity
        self._page = _map(root, f"sent-{topic}-{sender}", 64 + capacity * self._size)
        self._count = ctypes.c_uint64.from_buffer(self._page, 0)

    def push(self, message: ctypes.Structure) -> None:
        """Appends a message."""
        number = self._count.value
        place = 64 + (number % self._capacity) * self._size
        self._page[place : place + self._size] = bytes(message)
        self._count.value = number + 1

    def read(self) -> list[ctypes.Structure]:
        """The messages, the oldest first."""
        end = self._count.value
        places = (64 + (number % self._capacity) * self._size for number in range(max(0, end - self._capacity + 1), end))
        return [self._kind.from_buffer_copy(self._page, place) for place in places]


class Owner:
    """The supervisor of a run: a process ends when it has had none for the grace time and a second."""

    def __init__(self, root: str, grace_ms: int):
        page = _map(root, "supervisor", 32)
        self._pid = ctypes.c_int32.from_buffer(page, 0)
        self._heartbeat_ns = ctypes.c_uint64.from_buffer(page, 16)
        self._grace_ns = grace_ms * 10**6
        self._lost_ns: int | None = None
        self._looked_ns = 0

    def has_gone(self) -> bool:
        """Whether this process has to end."""
        now = time.monotonic_ns()
        if now - self._heartbeat_ns.value < 200_000_000:
            self._lost_ns = None
        elif now - self._looked_ns >= 50_000_000:
            self._looked_ns = now
            if _lives(self._pid.value):
                self._lost_ns = None
            elif self._lost_ns is None:
                self._lost_ns = now
        return self._lost_ns is not None and now - self._lost_ns >= self._grace_ns + 10**9


def _lives(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(") ", 1)[1][0] not in "ZX"
    except (OSError, IndexError):
        return False
