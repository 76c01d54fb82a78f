"""Cost of protocol and estimator on a Cortex-M4: flash, RAM, worst-case stack, instructions.

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
ROOT = HERE.parents[1]
C_FOLDER = ROOT / "firmware_protocol" / "c"
ENGINE = ROOT / "app" / "estimation" / "filters" / "engine"
ARM_FLAGS = ("-mcpu=cortex-m4", "-mthumb")
FPU_FLAGS = ("-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
ON_CHIP = ("-DVW_SINGLE", "-DVW_LANES=1", "-DVW_RC_MAX=3", f"-I{ENGINE}", f"-I{C_FOLDER / 'estimator'}")
SLAVES = tuple(C_FOLDER / "master" / f"vw_{name}.c" for name in ("ltc6804", "slaves", "slaves_values", "balance"))
MEASURING = (C_FOLDER / "master" / "vw_measuring.c",)
CELLS = (12, 96)
QEMU = ("qemu-system-arm", "-M", "netduinoplus2", "-icount", "shift=0", "-nographic", "-monitor", "none")
QEMU_OPTIONS = ("-serial", "none", "-semihosting-config", "enable=on,target=native")
CALIBRATION = 200_000
CYCLES_PER_INSTRUCTION = 1.6  # with the flash accelerator on; measure yours with DWT->CYCCNT
CLOCK_HZ = 168e6
LIBRARY_STACK = 32  # bytes for memcpy, memset, memcmp and arithmetic in software: they push at most eight registers
LIBRARY = {"memcpy", "memset", "memcmp", "memmove"}
MASTER = tuple(path for path in sorted((C_FOLDER / "master").glob("vw_*.c")) if path not in (*SLAVES, *MEASURING))
ENTRIES = ("vw_link_init", "vw_link_received", "vw_link_run", "vw_link_next", "vw_can_next", "vw_can_received")
SLAVES_ENTRIES = ("vw_slaves_start", "vw_slaves_read_voltages", "vw_slaves_read_temperatures", "vw_slaves_self_check")
MEASURING_ENTRIES = ("vw_measuring_add_samples", "vw_measuring_run")
MASTER_ENTRIES = ("vw_master_init", "vw_master_step", "vw_master_command")
ESTIMATOR_ENTRIES = ("vw_filter_start", "vw_filter_step")
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


def engine_sources() -> list[Path]:
    """Return the C files of the estimator, without what only a shared library has and what is learned next to it."""
    return [path for path in sorted(ENGINE.glob("vw_*.c")) if path.stem not in ("vw_library", "vw_resistance")]


def call_graph(
    compiler: str, optimisation: str, folder: Path, sources: list[Path], options: tuple[str, ...] = ()
) -> dict[str, Function]:
    """Compile and read gcc's call graph; a function of which there are several copies gets the largest."""
    functions: dict[str, Function] = {}
    for source in sources:
        flags = (f"-I{C_FOLDER}", *(ARM_FLAGS if compiler.startswith("arm") else ()), *options)
        command = [compiler, "-std=c99", *flags, optimisation, "-fcallgraph-info=su", "-c", str(source)]
        subprocess.run([*command, "-o", str(folder / f"{source.stem}.o")], cwd=folder, check=True)
        text = (folder / f"{source.stem}.ci").read_text(encoding="utf-8")
        for title, stack in re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \(\w+\)', text):
            function = functions.setdefault(bare(title), Function())
            function.stack = max(function.stack, int(stack))
        for caller, callee in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            name = bare(caller)
            target = INDIRECT.get(name, "a callback") if callee == "__indirect_call" else bare(callee)
            functions.setdefault(name, Function()).calls.add(target)
    return functions


def deepest(functions: dict[str, Function], name: str, above: tuple[str, ...] = ()) -> tuple[int, tuple[str, ...]]:
    """Return the most stack [byte] below a call, and the path that needs it; recursion is an error."""
    if name in above:
        raise SystemExit(f"recursion: {' > '.join((*above, name))}")
    if name in LIBRARY or name.startswith("__aeabi_"):
        return LIBRARY_STACK, (name,)
    function = functions.get(name, Function())
    below = [deepest(functions, callee, (*above, name)) for callee in sorted(function.calls)]
    stack, path = max(below, default=(0, ()))
    return function.stack + stack, (name, *path)


def print_stack(compiler: str) -> None:
    """Print each entry's worst case, without the firmware's own callbacks."""
    for optimisation in ("-Os", "-O2"):
        with tempfile.TemporaryDirectory() as folder:
            sources = [*sorted(C_FOLDER.glob("vw_*.c")), *SLAVES, *MEASURING, *MASTER]
            functions = call_graph(compiler, optimisation, Path(folder), sources)
            fpu = FPU_FLAGS if compiler.startswith("arm") else ()
            functions |= call_graph(compiler, optimisation, Path(folder), engine_sources(), (*ON_CHIP, *fpu))
        for entry in (*ENTRIES, *SLAVES_ENTRIES, *MEASURING_ENTRIES, *MASTER_ENTRIES, *ESTIMATOR_ENTRIES):
            stack, path = deepest(functions, entry)
            print(f"{compiler} {optimisation} stack {entry}: {stack} bytes ({' > '.join(path)})")


def run_on_chip(sources: list[Path], flags: tuple[str, ...], optimisation: str) -> dict[str, int]:
    """Return what a program of `bare_metal.h` prints: instructions, and sizes in bytes."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "firmware.elf"
        options = ("-std=gnu99", *ARM_FLAGS, optimisation, "-ffunction-sections", "-I", str(C_FOLDER), *flags)
        linking = ("-nostartfiles", "--specs=nano.specs", "-T", str(HERE / "link.ld"), "-Wl,--gc-sections", "-lm")
        subprocess.run(["arm-none-eabi-gcc", *options, *map(str, sources), *linking, "-o", str(program)], check=True)
        command = [*QEMU, *QEMU_OPTIONS, "-kernel", str(program)]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    lines = [line.rsplit(" ", 1) for line in (ran.stdout + ran.stderr).splitlines()]
    per_tick = CALIBRATION / int(lines[0][1])
    return {
        name: int(number) if name.startswith("size of") else round(int(number) * per_tick) for name, number in lines[1:]
    }


def microseconds(instructions: int) -> float:
    """Return the time of so many instructions at the STM32F405's clock."""
    return instructions * CYCLES_PER_INSTRUCTION / CLOCK_HZ * 1e6


def print_instructions() -> None:
    """Print what each call of the protocol takes, and a pass of the estimator."""
    for optimisation in ("-Os", "-O2"):
        counts = run_on_chip([*sorted(C_FOLDER.glob("vw_*.c")), HERE / "protocol.c"], (), optimisation)
        print_found(counts, optimisation)
        print_found(run_on_chip([*SLAVES, *MEASURING, HERE / "slaves.c"], (), optimisation), f"slaves, {optimisation}")
        sources = [*sorted(C_FOLDER.glob("vw_*.c")), *SLAVES, *MASTER, HERE / "master.c"]
        print_found(run_on_chip(sources, (), optimisation), f"master, {optimisation}")
    for optimisation in ("-Os", "-O2"):
        for n in CELLS:
            sources = [*engine_sources(), HERE / "estimator.c"]
            counts = run_on_chip(sources, (*FPU_FLAGS, *ON_CHIP, f"-DN_CELLS={n}"), optimisation)
            print_found(counts, f"estimator, {n} cells, {optimisation}")
            step = microseconds(counts["vw_filter_step"])
            print(
                f"estimator, {n} cells, {optimisation}: {step / n:.1f} us a cell, {step * 12 / n:.0f} us a slave of 12"
            )
    print("the thesis had 290 us for a slave of 12, the time in which the monitor delivers it")


def print_found(counts: dict[str, int], about: str) -> None:
    """Print instructions and sizes, a line each."""
    for name, number in counts.items():
        if name.startswith("size of"):
            print(f"{about} {name}: {number} bytes")
        else:
            print(f"{about} {name}: {number:,} instructions, about {microseconds(number):,.0f} us at 168 MHz")


def print_flash() -> None:
    """Print the size of code and constants: the protocol, the estimator, and the default cell's tables."""
    tables = [C_FOLDER / "estimator" / "vw_estimator.c"]
    flags = (*FPU_FLAGS, *ON_CHIP)
    print_size("protocol", sorted(C_FOLDER.glob("vw_*.c")), ())
    print_size("slaves", [*SLAVES], (f"-I{C_FOLDER}",))
    print_size("measuring", [*MEASURING], ())
    print_size("the rest of the master", [*MASTER], ())
    print_size("estimator", engine_sources(), flags)
    print_size("tables of the default cell, and the estimator on the struct", tables, flags)


def print_size(about: str, sources: list[Path], flags: tuple[str, ...]) -> None:
    """Print the flash that some sources take."""
    for optimisation in ("-Os", "-O2"):
        total = 0
        with tempfile.TemporaryDirectory() as folder:
            for source in sources:
                target = Path(folder) / f"{source.stem}.o"
                command = ["arm-none-eabi-gcc", "-std=c99", *ARM_FLAGS, *flags, optimisation, "-c", str(source)]
                subprocess.run([*command, "-o", str(target)], check=True)
                size = subprocess.run(["arm-none-eabi-size", str(target)], capture_output=True, text=True, check=True)
                total += sum(map(int, size.stdout.splitlines()[1].split()[:2]))
        print(f"{optimisation} flash, {about}: {total} bytes")


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
