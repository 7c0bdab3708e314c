"""Topics of a run over iceoryx2."""

import ctypes
from typing import Generic, TypeVar

import iceoryx2 as iox2
import numpy as np

from .errors import HapficError
from .messages import TOPICS
from .pages import Doorbells, Ring

T = TypeVar("T", bound=ctypes.Structure)


def _numbers(kind: type[ctypes.Structure], offset: int = 0) -> list[tuple[int, int]]:
    """Where the real numbers of a structure lie: offsets in units of 8 bytes, and counts."""
    places = []
    for name, field in kind._fields_:
        place, count = offset + getattr(kind, name).offset, 1
        while issubclass(field, ctypes.Array):
            count, field = count * field._length_, field._type_
        if field is ctypes.c_double:
            places.append((place // 8, count))
        elif issubclass(field, ctypes.Structure):
            for number in range(count):
                places += _numbers(field, place + number * ctypes.sizeof(field))
    return places


class Input(Generic[T]):
    """Receiver of a topic. A message with a number that is not finite is dropped and counted."""

    def __init__(self, subscriber, kind: type[T]):
        self._subscriber, self._kind, self.rejected = subscriber, kind, 0
        places = [index for begin, count in _numbers(kind) for index in range(begin, begin + count)]
        self._places = np.array(places, dtype=int)

    def next(self) -> T | None:
        """The oldest usable message that was not taken yet, copied out of shared memory."""
        while (sample := self._subscriber.receive()) is not None:
            message = self._kind.from_buffer_copy(sample.payload().contents)
            if len(self._places) == 0 or np.isfinite(np.frombuffer(message, dtype=float)[self._places]).all():
                return message
            self.rejected += 1
        return None

    def all(self) -> list[T]:
        """All messages that were not taken yet, the oldest first."""
        found = []
        while (message := self.next()) is not None:
            found.append(message)
        return found


class Output(Generic[T]):
    """Sender of a topic."""

    def __init__(self, publisher, ring: Ring | None, doorbell):
        self._publisher, self.ring, self._doorbell = publisher, ring, doorbell

    def send(self, message: T) -> None:
        """Sends a message: into the ring that outlives this process, to all receivers, and wakes them."""
        if self.ring is not None:
            self.ring.push(message)
        self.send_again(message)

    def send_again(self, message: T) -> None:
        """Sends a message that is in the ring already."""
        self._publisher.send_copy(message)
        if self._doorbell is not None:
            self._doorbell.notify()

    def connect(self) -> None:
        """Connects to receivers that have come since; they get the last messages."""
        self._publisher.update_connections()


class Bus:
    """Access of a process to the topics of a run."""

    def __init__(self, prefix: str, root: str, name: str, timeout_ms: int = 200):
        iox2.set_log_level(iox2.LogLevel.Fatal)
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(prefix)
        config.global_cfg.root_path = iox2.Path.new(root)
        # Removing what killed processes leave behind is the supervisor's work.
        config.global_cfg.node.cleanup_dead_nodes_on_creation = False
        config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
        config.global_cfg.service.cleanup_dead_nodes_on_open = False
        # A peer that is killed while it connects holds a sender up for so long.
        config.global_cfg.creation_timeout = iox2.Duration.from_millis(timeout_ms)
        self._root = root
        self.doorbells = Doorbells(root)
        try:
            builder = iox2.NodeBuilder.new().name(iox2.NodeName.new(name)).config(config)
            self._node = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled).create(iox2.ServiceType.Ipc)
        except Exception as cause:
            raise HapficError(f"cannot join the run in {root}: {cause}") from cause

    def _service(self, topic: str):
        kind = TOPICS[topic][0]
        try:
            return self._node.service_builder(iox2.ServiceName.new(topic)).publish_subscribe(kind).open()
        except Exception as cause:
            raise HapficError(
                f"topic '{topic}': found {cause}, expected {kind.__name__} of {ctypes.sizeof(kind)} bytes. "
                "Hint: program and package have to be of the same version"
            ) from cause

    def doorbell_of(self, topic: str):
        """The doorbell that sending on a topic notifies."""
        return self.doorbells[TOPICS[topic][1]]

    def input(self, topic: str, depth: int = 8) -> Input:
        """Opens a receiver that keeps as many messages; older ones are lost first."""
        builder = self._service(topic).subscriber_builder().buffer_size(depth)
        return Input(builder.create(), TOPICS[topic][0])

    def output(self, topic: str, sender: str, lockstep: bool) -> Output:
        """Opens the sender of a process of the run."""
        kind, doorbell, _, kept = TOPICS[topic]
        capacity = kept[lockstep]
        ring = Ring(self._root, topic, sender, kind, capacity) if capacity else None
        publisher = self._service(topic).publisher_builder().create()
        return Output(publisher, ring, None if doorbell is None else self.doorbells[doorbell])

    def client(self, request: type[ctypes.Structure], reply: type[ctypes.Structure]):
        """Opens a caller of the operator's service."""
        try:
            service = self._node.service_builder(iox2.ServiceName.new("operator_request"))
            return service.request_response(request, reply).open().client_builder().create()
        except Exception as cause:
            raise HapficError(f"the run answers no operators: {cause}") from cause
