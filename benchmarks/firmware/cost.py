"""What the C reference costs on a Cortex-M4: flash, RAM, worst-case stack, instructions.

    python benchmarks/firmware/cost.py [--cc gcc]

Stack: gcc's own figure for every function (-fcallgraph-info=su), summed over the call graph along its deepest path; a
call through a pointer counts as a call of every function that can stand there. Instructions: the functions run on an
emulated STM32F405 (QEMU with -icount: one instruction is one nanosecond), counted by its SysTick. Debian:
gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm; without them only the stack, with the host's gcc.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
C_FOLDER = HERE.parents[1] / "firmware_protocol" / "c"
ARM_FLAGS = ("-mcpu=cortex-m4", "-mthumb")
QEMU = ("qemu-system-arm", "-M", "netduinoplus2", "-icount", "shift=0", "-nographic", "-monitor", "none")
QEMU_OPTIONS = ("-serial", "none", "-semihosting-config", "enable=on,target=native")
CALIBRATION = 200_000
CYCLES_PER_INSTRUCTION = 1.6  # with the flash accelerator on; measure yours with DWT->CYCCNT
CLOCK_HZ = 168e6
LIBRARY_STACK = 32  # bytes for memcpy, memset, memcmp: newlib's push at most eight registers
LIBRARY = {"memcpy", "memset", "memcmp", "memmove"}
ENTRIES = ("vw_link_init", "vw_link_received", "vw_link_run", "vw_link_next", "vw_can_next", "vw_can_received")
# Who can stand behind a pointer; the firmware's own callbacks are its own to add.
INDIRECT = {
    "close_chunk": "on_item",
    "feed_master": "on_item",
    "vw_decoder_feed": "on_item",
    "vw_decoder_idle": "on_item",
}


@dataclass
class Function:
    """A function's own stack [byte] and whom it calls."""

    stack: int = 0
    calls: set[str] = field(default_factory=set)


def bare(name: str) -> str:
    """`file.c:send.part.0` is send."""
    return re.sub(r"\.(isra|part|constprop|cold)(\.\d+)?", "", name.rsplit(":", 1)[-1])


def call_graph(compiler: str, optimisation: str, folder: Path) -> dict[str, Function]:
    """Compile and read gcc's call graph; a function of which there are several copies gets the largest."""
    functions: dict[str, Function] = {}
    for source in sorted(C_FOLDER.glob("vw_*.c")):
        flags = ARM_FLAGS if compiler.startswith("arm") else ()
        command = [compiler, "-std=c99", *flags, optimisation, "-fcallgraph-info=su", "-c", str(source)]
        subprocess.run([*command, "-o", str(folder / f"{source.stem}.o")], cwd=folder, check=True)
        text = (folder / f"{source.stem}.ci").read_text(encoding="utf-8")
        for title, stack in re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \(\w+\)', text):
            found = functions.setdefault(bare(title), Function())
            found.stack = max(found.stack, int(stack))
        for caller, callee in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            name = bare(caller)
            target = INDIRECT.get(name, "a callback") if callee == "__indirect_call" else bare(callee)
            functions.setdefault(name, Function()).calls.add(target)
    return functions


def deepest(functions: dict[str, Function], name: str, above: tuple[str, ...] = ()) -> tuple[int, tuple[str, ...]]:
    """Return the most stack [byte] below a call, and the path that needs it; recursion is an error."""
    if name in above:
        raise SystemExit(f"recursion: {' > '.join((*above, name))}")
    if name in LIBRARY:
        return LIBRARY_STACK, (name,)
    function = functions.get(name, Function())
    below = [deepest(functions, callee, (*above, name)) for callee in sorted(function.calls)]
    stack, path = max(below, default=(0, ()))
    return function.stack + stack, (name, *path)


def print_stack(compiler: str) -> None:
    """Print each entry's worst case, without the firmware's own callbacks."""
    for optimisation in ("-Os", "-O2"):
        with tempfile.TemporaryDirectory() as folder:
            functions = call_graph(compiler, optimisation, Path(folder))
        for entry in ENTRIES:
            stack, path = deepest(functions, entry)
            print(f"{compiler} {optimisation} stack {entry}: {stack} bytes ({' > '.join(path)})")


def print_instructions() -> None:
    """Print flash and RAM, and what each call takes."""
    for optimisation in ("-Os", "-O2"):
        with tempfile.TemporaryDirectory() as folder:
            program = Path(folder) / "firmware.elf"
            sources = [*map(str, sorted(C_FOLDER.glob("vw_*.c"))), str(HERE / "bare_metal.c")]
            flags = ("-std=gnu99", *ARM_FLAGS, optimisation, "-ffunction-sections", "-I", str(C_FOLDER))
            linking = ("-nostartfiles", "--specs=nano.specs", "-T", str(HERE / "link.ld"), "-Wl,--gc-sections")
            subprocess.run(["arm-none-eabi-gcc", *flags, *sources, *linking, "-o", str(program)], check=True)
            ran = subprocess.run(
                [*QEMU, *QEMU_OPTIONS, "-kernel", str(program)], capture_output=True, text=True, timeout=60, check=True
            )
        lines = [line.rsplit(" ", 1) for line in (ran.stdout + ran.stderr).splitlines()]
        per_tick = CALIBRATION / int(lines[0][1])
        for name, number in lines[1:]:
            if name.startswith("size of"):
                print(f"{optimisation} {name}: {int(number)} bytes")
                continue
            instructions = int(number) * per_tick
            microseconds = instructions * CYCLES_PER_INSTRUCTION / CLOCK_HZ * 1e6
            print(f"{optimisation} {name}: {instructions:,.0f} instructions, about {microseconds:,.0f} us at 168 MHz")


def print_flash() -> None:
    """Print the size of the library's code and constants."""
    for optimisation in ("-Os", "-O2"):
        total = 0
        with tempfile.TemporaryDirectory() as folder:
            for source in sorted(C_FOLDER.glob("vw_*.c")):
                target = Path(folder) / f"{source.stem}.o"
                command = ["arm-none-eabi-gcc", "-std=c99", *ARM_FLAGS, optimisation, "-c", str(source)]
                subprocess.run([*command, "-o", str(target)], check=True)
                size = subprocess.run(["arm-none-eabi-size", str(target)], capture_output=True, text=True, check=True)
                total += sum(map(int, size.stdout.splitlines()[1].split()[:2]))
        print(f"{optimisation} flash: {total} bytes")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cc", help="compiler for the stack figures; default: arm-none-eabi-gcc where it is installed")
    arguments = parser.parse_args()
    arm = shutil.which("arm-none-eabi-gcc") is not None
    print_stack(arguments.cc or ("arm-none-eabi-gcc" if arm else "gcc"))
    if arm and arguments.cc is None:
        print_flash()
        if shutil.which(QEMU[0]) is not None:
            print_instructions()
    return 0


if __name__ == "__main__":
    sys.exit(main())
