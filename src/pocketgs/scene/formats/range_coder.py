"""An adaptive binary range coder for columns of integers.

A number is a sequence of binary decisions; the probability of each adapts to earlier decisions in the same context.
Reader and writer adapt in the same way, so no table is stored. Arithmetic uses integers of at most 32 bits, so that
`viewer/page/formats/range_decoder.js` decodes the same numbers.

A number v is coded as the length of |v| in bits (a unary code), the sign, and the bits of |v| after the leading one;
the first three of these have probabilities.
"""

from __future__ import annotations

import numpy as np

from pocketgs.system.compile import kernel, part

SLOTS = 112
"""Probabilities per context: 26 for the length, one for the sign, and 7 for the leading bits of each of 12 lengths."""

LONGEST = 26
"""Bits of the largest number's magnitude."""

SIGN, BITS = 26, 28
TREES = 12
CERTAIN, LEAST = 1 << 16, 32
SETTLED = 255
"""Number of decisions after which a probability adapts at a constant rate."""

# A probability moves by 1 / (n + 1.5) of the distance to the n-th decision, in units of 2^-14.
RATES = np.array([int((1 << 14) / (n + 1.5)) for n in range(SETTLED + 1)], np.int64)
LOW, RANGE, CACHE, PENDING, CODE, PLACE = range(6)
ROOM = 512
"""Upper bound of the bytes of one number."""

ACTIVITIES = 6
"""Number of classes of the distance between a prediction's two numbers, which divide a context."""

UNPREDICTED = np.full((0, 2), -1)


def new_models(contexts: int) -> np.ndarray:
    """(C, SLOTS, 2) probabilities of zeros in 1 / 65536, all one half, and numbers of decisions, all 0."""
    models = np.zeros((contexts * ACTIVITIES, SLOTS, 2), np.int64)
    models[..., 0] = CERTAIN // 2
    return models


class RangeEncoder:
    """Encodes columns of numbers into one stream of bytes."""

    def __init__(self) -> None:
        self._state = np.array([0, 0xFFFFFFFF, 0, 0, 0, 0], np.int64)
        self._bytes = np.zeros(1 << 16, np.uint8)

    def column(
        self, values: np.ndarray, contexts: np.ndarray, models: np.ndarray, predictions: np.ndarray = UNPREDICTED
    ) -> None:
        """Encode a column.

        Args:
            values: (N,) integers of a magnitude below 2^26.
            contexts: (N,) indices of models; numbers of one context are expected to be similar.
            models: from `new_models`; they adapt.
            predictions: (N, 2) indices of earlier rows whose mean is the prediction; negative to predict 0.
        """
        values = np.ascontiguousarray(values, np.int64)
        done = 0
        while done < len(values):
            if len(self._bytes) - self._state[PLACE] < 2 * ROOM:
                self._bytes = np.concatenate([self._bytes, np.zeros_like(self._bytes)])
            done = _encode(values, done, contexts, predictions, models, self._state, self._bytes)

    def finish(self) -> bytes:
        """The stream."""
        _flush(self._state, self._bytes)
        return self._bytes[1 : self._state[PLACE]].tobytes()


class RangeDecoder:
    """Decodes the columns that a `RangeEncoder` has encoded; zeros follow the end of the stream."""

    def __init__(self, stream: bytes) -> None:
        self._bytes = np.frombuffer(stream, np.uint8)
        code = int.from_bytes(stream[:4].ljust(4, b"\0"), "big")
        self._state = np.array([0, 0xFFFFFFFF, 0, 0, code, 4], np.int64)

    def column(self, contexts: np.ndarray, models: np.ndarray, predictions: np.ndarray = UNPREDICTED) -> np.ndarray:
        """(N,) numbers of the next column; contexts, models and predictions must be those of the encoder."""
        values = np.zeros(len(contexts), np.int64)
        _decode(values, contexts, predictions, models, self._state, self._bytes)
        return values


@part
def _expected(values: np.ndarray, predictions: np.ndarray, index: int) -> tuple[int, int]:
    """The prediction of a number, and the distance between its two numbers, as a length in bits."""
    if len(predictions) == 0 or predictions[index, 0] < 0:
        return 0, 0
    first, second = values[predictions[index, 0]], values[predictions[index, 1]]
    apart, length = abs(first - second), 0
    while apart:
        apart >>= 1
        length += 1
    return (first + second) >> 1, min(length, ACTIVITIES - 1)


@part
def _adapt(models: np.ndarray, context: int, slot: int, bit: int) -> None:
    zero, count = models[context, slot, 0], models[context, slot, 1]
    target = 0 if bit else CERTAIN
    zero += ((target - zero) * RATES[count]) >> 14
    models[context, slot, 0] = min(max(zero, LEAST), CERTAIN - LEAST)
    models[context, slot, 1] = min(count + 1, SETTLED)


@part
def _shift_low(state: np.ndarray, sink: np.ndarray) -> None:
    """Move the highest byte of the low end to the stream, once no carry can change it."""
    if state[LOW] < 0xFF000000 or state[LOW] > 0xFFFFFFFF:
        carry = state[LOW] >> 32
        sink[state[PLACE]] = (state[CACHE] + carry) & 0xFF
        state[PLACE] += 1
        while state[PENDING]:
            sink[state[PLACE]] = (0xFF + carry) & 0xFF
            state[PLACE] += 1
            state[PENDING] -= 1
        state[CACHE] = (state[LOW] >> 24) & 0xFF
    else:
        state[PENDING] += 1
    state[LOW] = (state[LOW] << 8) & 0xFFFFFFFF


@part
def _put(bound: int, bit: int, state: np.ndarray, sink: np.ndarray) -> None:
    if bit:
        state[LOW] += bound
        state[RANGE] -= bound
    else:
        state[RANGE] = bound
    while state[RANGE] < 1 << 24:
        state[RANGE] = (state[RANGE] << 8) & 0xFFFFFFFF
        _shift_low(state, sink)


@part
def _put_bit(bit: int, models: np.ndarray, context: int, slot: int, state: np.ndarray, sink: np.ndarray) -> None:
    _put((state[RANGE] >> 16) * models[context, slot, 0], bit, state, sink)
    _adapt(models, context, slot, bit)


@part
def _put_number(value: int, models: np.ndarray, context: int, state: np.ndarray, sink: np.ndarray) -> None:
    size, length = abs(value), 0
    while size >> length:
        length += 1
    for place in range(length):
        _put_bit(1, models, context, place, state, sink)
    if length < LONGEST:
        _put_bit(0, models, context, length, state, sink)
    if length:
        _put_bit(1 if value < 0 else 0, models, context, SIGN, state, sink)
    node = 1
    for place in range(length - 2, -1, -1):
        bit = (size >> place) & 1
        if node < 8 and length <= TREES + 1:
            _put_bit(bit, models, context, BITS + 7 * (length - 2) + node - 1, state, sink)
            node = 2 * node + bit
        else:
            _put(state[RANGE] >> 1, bit, state, sink)


@kernel
def _encode(
    values: np.ndarray,
    first: int,
    contexts: np.ndarray,
    predictions: np.ndarray,
    models: np.ndarray,
    state: np.ndarray,
    sink: np.ndarray,
) -> int:
    for index in range(first, len(values)):
        if state[PLACE] + state[PENDING] + ROOM > len(sink):
            return index
        expected, activity = _expected(values, predictions, index)
        _put_number(values[index] - expected, models, contexts[index] * ACTIVITIES + activity, state, sink)
    return len(values)


@kernel
def _flush(state: np.ndarray, sink: np.ndarray) -> None:
    for _ in range(5):
        _shift_low(state, sink)


@part
def _take(bound: int, state: np.ndarray, source: np.ndarray) -> int:
    bit = 1 if state[CODE] >= bound else 0
    if bit:
        state[CODE] -= bound
        state[RANGE] -= bound
    else:
        state[RANGE] = bound
    while state[RANGE] < 1 << 24:
        place = state[PLACE]
        byte = source[place] if place < len(source) else 0
        state[PLACE] = place + 1
        state[RANGE] = (state[RANGE] << 8) & 0xFFFFFFFF
        state[CODE] = ((state[CODE] << 8) | byte) & 0xFFFFFFFF
    return bit


@part
def _take_bit(models: np.ndarray, context: int, slot: int, state: np.ndarray, source: np.ndarray) -> int:
    bit = _take((state[RANGE] >> 16) * models[context, slot, 0], state, source)
    _adapt(models, context, slot, bit)
    return bit


@part
def _take_number(models: np.ndarray, context: int, state: np.ndarray, source: np.ndarray) -> int:
    length = 0
    while length < LONGEST and _take_bit(models, context, length, state, source):
        length += 1
    if not length:
        return 0
    is_negative = _take_bit(models, context, SIGN, state, source)
    size, node = 1, 1
    for _ in range(length - 1):
        if node < 8 and length <= TREES + 1:
            bit = _take_bit(models, context, BITS + 7 * (length - 2) + node - 1, state, source)
            node = 2 * node + bit
        else:
            bit = _take(state[RANGE] >> 1, state, source)
        size = 2 * size + bit
    return -size if is_negative else size


@kernel
def _decode(
    values: np.ndarray,
    contexts: np.ndarray,
    predictions: np.ndarray,
    models: np.ndarray,
    state: np.ndarray,
    source: np.ndarray,
) -> None:
    for index in range(len(values)):
        expected, activity = _expected(values, predictions, index)
        value = _take_number(models, contexts[index] * ACTIVITIES + activity, state, source)
        values[index] = value + expected
