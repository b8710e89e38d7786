"""What libraries of Linux, Windows and macOS export, read from their tables."""

import struct

REFERENCE = "extra/org.fmi-standard.fmi-ls-ref/"
"""Folder of the reference results in a native FMU."""


def elf_exports(data: bytes) -> set[str]:
    (table,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + i * size) for i in range(count)]
    (dynamic,) = [s for s in sections if s[1] == 11]
    names = sections[dynamic[6]]
    symbols: set[str] = set()
    for at in range(dynamic[4], dynamic[4] + dynamic[5], 24):
        name, _, _, section = struct.unpack_from("<IBBH", data, at)
        if section:
            symbols.add(text_at(data, names[4] + name))
    return symbols


def text_at(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()


def macho_parts(data: bytes) -> dict[int, bytes]:
    if data[:4] != b"\xca\xfe\xba\xbe":
        return {struct.unpack_from("<I", data, 4)[0]: data}
    (count,) = struct.unpack_from(">I", data, 4)
    rows = [struct.unpack_from(">5I", data, 8 + 20 * k) for k in range(count)]
    assert all(offset % (1 << align) == 0 for _, _, offset, _, align in rows)
    return {cpu: data[offset : offset + size] for cpu, _, offset, size, _ in rows}


def macho_exports(data: bytes) -> set[str]:
    magic, _, _, filetype, n_commands = struct.unpack_from("<5I", data, 0)
    assert (magic, filetype) == (0xFEEDFACF, 6)  # 64 bits, shared library
    place, exported = 32, set()
    for _ in range(n_commands):
        command, size = struct.unpack_from("<2I", data, place)
        if command == 2:  # LC_SYMTAB
            symbols, count, strings, _ = struct.unpack_from("<4I", data, place + 8)
            for k in range(count):
                name, kind, section, _, _ = struct.unpack_from("<IBBHQ", data, symbols + 16 * k)
                if kind & 1 and not kind & 0x10 and section:  # external, not private, defined
                    end = data.index(b"\0", strings + name)
                    exported.add(data[strings + name : end].decode())
        place += size
    return exported
