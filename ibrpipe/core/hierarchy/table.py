"""A table of what has been shaded already: open addressing, keys of two numbers."""

from __future__ import annotations

from ibrpipe.core.jit import helper, serial

EMPTY = -1


@helper
def _mix(stack, key, size):
    # -> first place of a key in a table whose size is a power of two
    h = stack * 2654435761 + key * 40503
    return (h ^ (h >> 15) ^ (h >> 32)) & (size - 1)


@serial
def look_up(keys, lengths, used, table, found, fresh):
    # keys (I, 2) i64; lengths (T,) i64: shaded texels of each stack; used: texels shaded so far
    # table (K, 3) i64: stack, key of the lights, entry; EMPTY where free; the last row is no entry
    # -> found (I,) i64: entry of each key; fresh (I, 3) i64: stack, key, first texel of new ones
    # -> number of new ones, texels used; entries are numbered on from table[-1, 2], the number of entries
    size = len(table) - 1
    count = table[size, 2]
    made = 0
    for i in range(len(keys)):
        place = _mix(keys[i, 0], keys[i, 1], size)
        while table[place, 0] != EMPTY and (table[place, 0] != keys[i, 0] or table[place, 1] != keys[i, 1]):
            place = (place + 1) & (size - 1)
        if table[place, 0] == EMPTY:
            table[place, 0], table[place, 1], table[place, 2] = keys[i, 0], keys[i, 1], count + made
            fresh[made, 0], fresh[made, 1], fresh[made, 2] = keys[i, 0], keys[i, 1], used
            used += lengths[keys[i, 0]]
            made += 1
        found[i] = table[place, 2]
    table[size, 2] = count + made
    return made, used


@serial
def grow(table, larger):
    # moves all entries of a table to a larger one, which is EMPTY but for its last row
    size = len(larger) - 1
    for i in range(len(table) - 1):
        if table[i, 0] != EMPTY:
            place = _mix(table[i, 0], table[i, 1], size)
            while larger[place, 0] != EMPTY:
                place = (place + 1) & (size - 1)
            for c in range(3):
                larger[place, c] = table[i, c]
    larger[size, 2] = table[len(table) - 1, 2]
