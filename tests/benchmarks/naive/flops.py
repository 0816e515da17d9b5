#!/usr/bin/env python3
"""Floating-point operations, instructions and their share per particle and step, from two runs of different length.

usage: flops.py SHORT.out LONG.out PARTICLE_STEPS [PART_OF_LIBRARY_NAME ...]

The files are callgrind's, with --dump-instr=yes --compress-pos=no --compress-strings=no; PARTICLE_STEPS is particles times the
difference of steps. Every executed instruction is looked up in the disassembly (objdump): a vector counts as many operations as
it has lanes, a fused multiply-add two; minimum, maximum, comparisons, conversions and shuffles none.
"""
import collections
import re
import subprocess
import sys

ARITHMETIC = re.compile(r"v?(add|sub|mul|div|sqrt|addsub|hadd)(p|s)(s|d)$")
FUSED = re.compile(r"vfn?m(add|sub|addsub|subadd)\d{3}(p|s)(s|d)$")
BYTES = {"x": 16, "y": 32, "z": 64}


def executed(path):
    """(object, address) -> times"""
    counts = collections.Counter()
    library, skip = "", False
    with open(path) as lines:
        for line in lines:
            if line.startswith("ob="):
                library = line[3:].strip()
            elif line.startswith("calls="):
                skip = True  # the next line is the cost of what was called
            elif line.startswith("0x"):
                if not skip:
                    address, _, count = line.split()[:3]
                    counts[library, int(address, 16)] += int(count)
                skip = False
    return counts


def operations(library):
    """address -> floating-point operations of the instruction there"""
    found = {}
    text = subprocess.run(["objdump", "-d", "--no-show-raw-insn", library], capture_output=True, text=True, check=True).stdout
    for line in text.splitlines():
        match = re.match(r"\s*([0-9a-f]+):\s+(\S+)\s*(.*)", line)
        if not match:
            continue
        name, operands = match[2], match[3]
        fused = FUSED.match(name)
        kind = fused or ARITHMETIC.match(name)
        if not kind:
            continue
        lanes = 1
        if kind[2] == "p":
            lanes = BYTES[re.findall(r"%([xyz])mm", operands)[-1]] // (4 if kind[3] == "s" else 8)
        found[int(match[1], 16)] = lanes * (2 if fused else 1)
    return found


def main():
    short, long = executed(sys.argv[1]), executed(sys.argv[2])
    work, wanted = float(sys.argv[3]), sys.argv[4:]
    libraries = sorted({library for library, _ in long if not wanted or any(w in library for w in wanted)})
    for library in libraries:
        of = operations(library)
        instructions = flops = vectors = 0
        for (where, address), count in long.items():
            if where != library:
                continue
            count -= short[where, address]
            instructions += count
            flops += count * of.get(address, 0)
            vectors += count * (address in of)
        print(f"{library}: {instructions / work:.0f} instructions, {vectors / work:.0f} of them arithmetic, "
              f"{flops / work:.0f} floating-point operations")


if __name__ == "__main__":
    main()
