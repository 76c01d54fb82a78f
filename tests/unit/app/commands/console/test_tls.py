import segno

from app.commands.console.tls import qr_lines


def test_the_lines_are_the_modules_of_the_code_light_on_dark():
    text = "https://192.168.100.123:8000/"
    modules = {"█": (0, 0), "▀": (0, 1), "▄": (1, 0), " ": (1, 1)}
    lines = qr_lines(text)
    rows = [[modules[each][half] for each in line] for line in lines for half in (0, 1)]
    matrix = [[int(each) for each in row] for row in segno.make(text, error="m", micro=False).matrix_iter(border=2)]
    assert rows[: len(matrix)] == matrix
    assert max(map(len, lines)) < 80
