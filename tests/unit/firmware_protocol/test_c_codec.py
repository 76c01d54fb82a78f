"""The C reference codec, compiled with gcc, against the shared vectors and against Python on random streams."""

import random
import subprocess
from pathlib import Path

import pytest

from firmware_protocol import c_header, config_image, eeprom, framing, messages
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import Frame
from firmware_protocol.memory_map import CONFIG_FIELDS
from firmware_protocol.messages import MAX_READ, NO_OFFSET, MessageType, Read, Result, Write
from tests.c_programs import build_program, require_gcc
from tests.host_requests import decode_request

C_FOLDER = Path(framing.__file__).parent / "c"
VECTORS = Path(__file__).parents[2] / "vectors"
SOURCES = tuple(
    sorted(str(path.relative_to(C_FOLDER)) for part in (".", "master") for path in C_FOLDER.glob(f"{part}/vw_*.c"))
)

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-I", str(C_FOLDER))


def compile_c(*arguments):
    return subprocess.run(["gcc", *arguments], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def gcc():
    require_gcc()


@pytest.fixture(scope="module")
def host_test():
    return build_program("host_test")


def drive(program, lines):
    done = subprocess.run(
        [program, "driver"], input="".join(f"{line}\n" for line in lines), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    answers = done.stdout.splitlines()
    assert len(answers) == len(lines)
    return answers


@pytest.mark.parametrize("standard", ["c99", "c11", "c17"])
def test_header_compiles_by_itself_and_asserts_every_offset(gcc, tmp_path, standard):
    source = tmp_path / "only.c"
    source.write_text('#include "generated/voltwall_protocol.h"\nint only;\n', encoding="utf-8")
    built = compile_c(f"-std={standard}", *STRICT, "-c", str(source), "-o", str(tmp_path / "only.o"))
    assert built.returncode == 0, built.stderr


def test_a_wrong_offset_does_not_compile(gcc, tmp_path):
    text = c_header.header_text().replace("offsetof(vw_master_t, v) == 1896u", "offsetof(vw_master_t, v) == 1898u")
    (tmp_path / "wrong.c").write_text(text, encoding="utf-8")
    built = compile_c("-std=c99", "-c", str(tmp_path / "wrong.c"), "-o", str(tmp_path / "wrong.o"))
    assert "vw_assert_master_v" in built.stderr


@pytest.fixture(scope="module", params=SOURCES)
def codec(request, gcc, tmp_path_factory):
    """A source of the codec, compiled with every warning: what gcc said, and its object file."""
    flags = ("-Wconversion", "-Wsign-conversion", "-Wcast-qual", "-Wstrict-prototypes", "-Wmissing-prototypes")
    made = tmp_path_factory.mktemp("codec") / "codec.o"
    return compile_c("-std=c99", "-O2", *STRICT, *flags, "-c", str(C_FOLDER / request.param), "-o", str(made)), made


def test_codec_compiles_without_a_conversion_warning(codec):
    built, _ = codec
    assert built.returncode == 0, built.stderr


def test_the_stm32_port_compiles_against_the_hal_that_it_names(gcc, tmp_path):
    hal = ("-I", str(Path(__file__).parent / "hal"), "-Wconversion", "-Wsign-conversion")
    source = str(C_FOLDER / "stm32f4" / "vw_stm32f4.c")
    built = compile_c("-std=c99", "-O2", *STRICT, *hal, "-c", source, "-o", str(tmp_path / "port.o"))
    assert built.returncode == 0, built.stderr


def test_codec_has_no_heap_and_no_writable_globals(codec):
    symbols = subprocess.run(["nm", codec[1]], capture_output=True, text=True, check=True).stdout.split("\n")
    used = {line.split()[-1] for line in symbols if " U " in line}
    assert {name for name in used if not name.startswith("vw_")} <= {"memcpy", "memset", "memcmp", "__stack_chk_fail"}
    assert not [line for line in symbols if line[17:18] in tuple("bBdDC")]


def test_shared_vectors(host_test):
    done = subprocess.run([host_test, "vectors", VECTORS], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) > 350


def test_encoder_agrees_with_python(host_test):
    rng = random.Random(7)
    lengths = [0, 1, 245, 246, 247, 248, 500, 511, 512, *(rng.randrange(513) for _ in range(60))]
    fills = (b"\0", b"\xaa", b"\0\x01\xff", bytes(range(256)))
    cases = [
        (rng.randrange(256), rng.randrange(256), rng.randrange(1 << 32), bytes(rng.choice(fill) for _ in range(n)))
        for n in lengths
        for fill in fills
    ]
    answers = drive(host_test, [f"encode {t} {s} {u} {body.hex() or '-'}" for t, s, u, body in cases])
    for case, answer in zip(cases, answers, strict=True):
        assert bytes.fromhex(answer) == framing.encode_frame(*case)


def random_bodies(rng, n):
    for _ in range(n):
        length = rng.choice((0, 3, 4, 5, 6, 11, 12, 13, 30))
        yield bytes(rng.choice((0, 1, 4, 8, rng.randrange(256))) for _ in range(length))


def expected_request(kind, body):
    """Return the result word and the body that a request comes to, judged by the Python side and SPEC's bounds."""
    try:
        request = decode_request(Frame(kind, 0, 0, body))
    except DecodeError as error:
        unknown = error.what == "request"
        return Result.UNKNOWN_REQUEST if unknown else Result.BAD_LENGTH, NO_OFFSET, b""
    match request:
        case Read(offset, length):
            end = 2984 if offset < 0x8000 else 0x10000
            if not 0 < length <= MAX_READ:
                return Result.BAD_LENGTH, NO_OFFSET, b""
            if offset + length > end:
                return Result.OUT_OF_BOUNDS, offset, b""
        case Write(offset, data):
            if not data:
                return Result.BAD_LENGTH, NO_OFFSET, b""
            if offset + len(data) > 420:
                return Result.OUT_OF_BOUNDS, offset, b""
    return Result.DONE, NO_OFFSET, body


def test_requests_agree_with_python(host_test):
    rng = random.Random(11)
    kinds = [kind for kind in MessageType if kind >= MessageType.IDENT] + [0x7F]
    cases = [(int(kind), body) for kind in kinds for body in random_bodies(rng, 80)]
    cases += [(int(MessageType.READ), bytes.fromhex(h)) for h in ("a70b0100", "a70b0200", "ffff0100", "ffff0200")]
    answers = drive(host_test, [f"request {kind} {body.hex() or '-'}" for kind, body in cases])
    for (kind, body), answer in zip(cases, answers, strict=True):
        result, offset, rebuilt = expected_request(kind, body)
        assert answer == f"{int(result)} {offset} {rebuilt.hex() or '-'}", (kind, body.hex())


def test_messages_agree_with_python(host_test):
    rng = random.Random(13)
    cases = [(kind, body) for kind in (1, 2, 3, 9) for body in random_bodies(rng, 150)]
    answers = drive(host_test, [f"message {kind} {body.hex() or '-'}" for kind, body in cases])
    valid = 0
    for (kind, body), answer in zip(cases, answers, strict=True):
        try:
            messages.decode_message(Frame(kind, 0, 0, body))
            expected = f"valid {body.hex() or '-'}"
            valid += 1
        except DecodeError:
            expected = "invalid"
        assert answer == expected, (kind, body.hex())
    assert valid > 100


DEFAULT = config_image.default_image()


def images_around_the_limits(rng):
    """Default images with one or two elements at, just beyond or far from their limits, and random ones."""
    for _ in range(500):
        image = bytearray(DEFAULT)
        for _ in range(rng.randrange(1, 3)):
            field = rng.choice(CONFIG_FIELDS)
            at = field.offset + rng.randrange(field.count) * field.item_size
            special = (
                field.minimum,
                field.maximum,
                field.minimum - 1,
                field.maximum + 1,
                2983,
                2984,
                420,
                419,
                8,
                0x800,
            )
            value = rng.choice((*special, rng.getrandbits(32), 0xA0000000, 0x9FFFFFFF))
            image[at : at + field.item_size] = (value % (1 << 8 * field.item_size)).to_bytes(field.item_size, "little")
        yield bytes(image)
    for _ in range(100):
        yield rng.randbytes(len(DEFAULT))


def test_configuration_check_agrees_with_python(host_test):
    images = [DEFAULT, *images_around_the_limits(random.Random(17))]
    answers = drive(host_test, [f"check {image.hex()}" for image in images])
    expected = [next((error.offset for error in config_image.check(image)), NO_OFFSET) for image in images]
    assert list(map(int, answers)) == expected
    assert 50 < expected.count(NO_OFFSET) < 450


def test_slots_agree_with_python(host_test):
    rng = random.Random(19)
    cases = [(rng.randrange(1, 1 << 32), rng.randbytes(len(DEFAULT))) for _ in range(20)]
    answers = drive(host_test, [f"slot {counter} {image.hex()}" for counter, image in cases])
    assert [bytes.fromhex(answer) for answer in answers] == [eeprom.encode_slot(image, n) for n, image in cases]


def test_newest_slot_agrees_with_python(host_test):
    rng = random.Random(23)
    pairs = []
    for _ in range(200):
        pair = [bytearray(eeprom.encode_slot(rng.randbytes(len(DEFAULT)), rng.randrange(1, 4))) for _ in range(2)]
        for slot in pair:
            if rng.random() < 0.4:
                slot[rng.choice((0, 4, 6, 8, 12, 64, 300, 483, 16, 500))] ^= 1 << rng.randrange(8)
        pairs.append(pair)
    for pair, answer in zip(pairs, drive(host_test, [f"newest {a.hex()} {b.hex()}" for a, b in pairs]), strict=True):
        found = eeprom.newest(b"".join(pair))
        expected = "-1" if found is None else f"{found.slot} {found.counter} {found.image.hex()}"
        assert answer == expected
