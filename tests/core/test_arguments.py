"""The flags of the command line say what the dataclasses say."""

import pytest
from enfilade.core.arguments import Parser, add_options, format_size, options_from, parse_size
from enfilade.core.options import BakeOptions, OptionError, Options, describe


def parse(cls, *words, base=None):
    parser = Parser(prog="enfilade")
    add_options(parser, cls, "options")
    return options_from(parser.parse_args(words), cls, base)


@pytest.mark.parametrize(
    ("text", "count"),
    [("0", 0), ("4096", 4096), ("500M", 500 * 2**20), ("2G", 2**31), ("1.5g", 3 * 2**29), ("3 kB", 3072), ("1TiB", 2**40), (".5K", 512)],
)
def test_sizes(text, count):
    assert parse_size(text) == count


@pytest.mark.parametrize("text", ["", "G", "2X", "-1", "1,5G", "2 G B"])
def test_bad_sizes(text):
    with pytest.raises(OptionError, match="not a size"):
        parse_size(text)


@pytest.mark.parametrize("count", [0, 1, 1500, 1024, 3 * 2**20, 2**31, 5 * 2**40])
def test_sizes_are_read_back(count):
    assert parse_size(format_size(count)) == count


@pytest.mark.parametrize("cls", [Options, BakeOptions])
def test_no_flags_give_the_defaults(cls):
    assert parse(cls) == cls()


@pytest.mark.parametrize("cls", [Options, BakeOptions])
def test_every_option_has_a_flag(cls):
    for info in describe(cls):
        if info.kind == "bool":
            words, value = [info.flag], True
        elif info.kind == "choice":
            words, value = [info.flag, info.choices[-1]], info.choices[-1]
        elif info.kind in ("path", "name"):
            words, value = [info.flag, "abc"], "abc"
        else:
            words, value = [info.flag, str(info.minimum)], info.minimum
        assert getattr(parse(cls, *words), info.name) == value


def test_flags_go_over_a_base():
    base = Options(quality="draft", order=3, memory=7)
    assert parse(Options, "--order", "1", base=base) == Options(quality="draft", order=1, memory=7)


def test_a_flag_can_be_taken_back():
    assert parse(BakeOptions, "--no-material", base=BakeOptions(material=True)).material is False


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--order", "two"), "'two' is not a whole number"),
        (("--order", "4"), "order: 4 must be between 1 and 3"),
        (("--quality", "best"), "best"),
        (("--memory", "lots"), "'lots' is not a size"),
        (("--large-polygon", "nan"), "large_polygon"),
        (("--unknown", "1"), "unrecognized arguments"),
    ],
)
def test_bad_values_are_one_sentence(words, sentence):
    with pytest.raises(OptionError, match=sentence) as caught:
        parse(Options, *words)
    assert "\n" not in str(caught.value)


def test_help_shows_every_default(capsys):
    parser = Parser(prog="enfilade")
    add_options(parser, Options)
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--help"])
    assert end.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "draft 10 %, good 3 %, fine 1 % [good]" in text
    assert "longer than this is a cluster of its own (m) [1.0]" in text
