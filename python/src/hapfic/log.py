"""Logs as arrays."""

import glob
import re
from typing import Any

import numpy as np

from .errors import HapficError


def parts(path: str) -> list[str]:
    """The files of a log, in order: `run.mcap`, `run.part2.mcap`, ..."""
    stem = path[: -len(".mcap")] if path.endswith(".mcap") else path
    later = [file for file in glob.glob(glob.escape(stem) + ".part*.mcap") if re.search(r"\.part(\d+)\.mcap$", file)]
    return [path] + sorted(later, key=lambda file: int(re.search(r"\.part(\d+)\.mcap$", file)[1]))


def read_log(path: str, topics: list[str] | None = None) -> dict[str, dict[str, np.ndarray]]:
    """Reads a log: topic, field, array. The first axis counts messages; `time_s` is the log time [s].

    Numbers and lists of the same length become arrays; nested messages have dotted names; texts become arrays of objects.
    Raises HapficError if a file cannot be read.
    """
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    rows: dict[str, list] = {}
    for file in parts(path):
        try:
            with open(file, "rb") as opened:
                reader = make_reader(opened, decoder_factories=[DecoderFactory()])
                for _, channel, message, content in reader.iter_decoded_messages(topics=topics):
                    rows.setdefault(channel.topic, []).append((message.log_time, content))
        except Exception as cause:
            raise HapficError(f"{file}: found {cause}, expected a log. Hint: `hapfic recover` mends one that was cut off") from cause
    return {topic: _columns(messages) for topic, messages in rows.items()}


def _columns(messages: list) -> dict[str, np.ndarray]:
    columns: dict[str, list] = {}
    for number, (_, message) in enumerate(messages):
        for name, value in _flat(message, ""):
            columns.setdefault(name, [None] * len(messages))[number] = value
    arrays = {"time_s": np.array([time for time, _ in messages], dtype=float) * 1e-9}
    for name, values in columns.items():
        arrays[name] = _array(values)
    return arrays


def _flat(message: Any, prefix: str):
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        name = prefix + field.name
        many = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
        if field.message_type is None:
            yield name, list(value) if many else value
        elif many:
            yield name, list(value)
        elif message.HasField(field.name):
            if field.message_type.full_name.startswith("google.protobuf."):
                yield name, value
            else:
                yield from _flat(value, name + ".")


def _array(values: list) -> np.ndarray:
    try:
        array = np.array(values)
        if array.dtype != object and array.dtype.kind in "fiub":
            return array
    except ValueError:
        pass
    plain = np.empty(len(values), dtype=object)
    plain[:] = values
    return plain
