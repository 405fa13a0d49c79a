"""C types, as MAVLink's definitions and ULog's formats name them, and their letters in `struct`."""

from typing import Final

LETTERS: Final = {
    "char": "c",
    "bool": "?",
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
}
