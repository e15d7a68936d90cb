"""Readers of luminaire photometry: good files of every form, and whatever can be wrong with one."""

import math

import numpy as np
import pytest
from enfilade.core.luminaire_files import LARGEST_FILE, read_luminaire
from enfilade.core.luminaires import illuminance
from enfilade.core.scene import SceneError
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from luminaire_samples import ies, ldt

GAMMA = [0, 30, 60, 90]
DOWN, FRONT, LEFT = [0.0, 0, -1], [1.0, 0, 0], [0.0, 1, 0]


@pytest.fixture
def read(tmp_path):
    def read(text, name="lamp.ies"):
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return read_luminaire(path)

    return read


def towards(azimuth, gamma):
    azimuth, gamma = np.radians(azimuth), np.radians(gamma)
    return np.array([[math.sin(gamma) * math.cos(azimuth), math.sin(gamma) * math.sin(azimuth), -math.cos(gamma)]])


def at(luminaire, azimuth, gamma=45.0):
    return float(luminaire.distribution.intensity(towards(azimuth, gamma))[0])


# ---- IES LM-63


@pytest.mark.parametrize(
    ("edition", "factor"),
    [("", 0.45), ("IESNA91", 0.45), ("IESNA:LM-63-1995", 0.9), ("IESNA:LM-63-2002", 0.9), ("IES:LM-63-2019", 0.9)],
)
def test_factors_of_every_edition(read, edition, factor):
    luminaire = read(ies([0, 90], [0], [[100, 0]], edition=edition, multiplier=2, factors=(0.45, 0.5, 33)))
    assert luminaire.distribution.intensity(np.array([DOWN])) == pytest.approx(100 * factor)
    assert luminaire.name == ("made up" if edition else "a label of 1986")
    assert luminaire.watts == 33


def test_numbers_break_lines_anywhere_and_commas_part_them(read):
    text = ies([0, 45, 90], [0, 90], [[100, 60, 10], [90, 50, 5]])
    head, _, body = text.partition("TILT=NONE\r\n")
    expected = read(text).distribution
    for broken in (",".join(body.split()), "\n".join(body.split()), " , ".join(body.split()) + "\nEND\n\x1a"):
        found = read(head + "TILT=NONE\n" + broken).distribution
        assert np.array_equal(found.candela, expected.candela)
        assert np.array_equal(found.azimuth, expected.azimuth)


def test_one_half_plane_is_symmetric_about_the_vertical(read):
    luminaire = read(ies([0, 90], [0], [[1000, 100]]))
    assert [at(luminaire, c) for c in (0, 77, 180, 300)] == pytest.approx([550] * 4)
    assert luminaire.distribution.flux() == pytest.approx(read(ies([0, 90], [0, 360], [[1000, 100]] * 2)).distribution.flux())


def test_quadrant_half_and_whole(read):
    rng = np.random.default_rng(3)
    planes = rng.uniform(10, 500, (5, 4))
    planes[:, 0] = 250
    quadrant = read(ies(GAMMA, [0, 20, 45, 70, 90], planes))
    for c in (0, 13, 45, 81, 90):
        assert [at(quadrant, a, 50) for a in (180 - c, 180 + c, -c)] == pytest.approx([at(quadrant, c, 50)] * 3)
    assert at(quadrant, 20, 60) == pytest.approx(planes[1, 2])

    half = read(ies(GAMMA, [0, 45, 90, 135, 180], planes))
    assert [at(half, -c, 60) for c in (0, 45, 90, 135, 180)] == pytest.approx(planes[:, 2])
    assert at(half, 45, 60) != pytest.approx(at(half, 135, 60))

    other = read(ies(GAMMA, [90, 135, 180, 225, 270], planes))
    assert [at(other, c, 60) for c in (90, 135, 180, 225, 270)] == pytest.approx(planes[:, 2])
    assert [at(other, 180 - c, 60) for c in (90, 135, 180, 225, 270)] == pytest.approx(planes[:, 2])

    open_end = read(ies(GAMMA, [0, 72, 144, 216, 288], planes))
    whole = read(ies(GAMMA, [0, 72, 144, 216, 288, 360], np.vstack((planes, planes[:1]))))
    assert [at(open_end, c) for c in (10, 300, 350)] == pytest.approx([at(whole, c) for c in (10, 300, 350)])
    assert at(whole, 72, 60) == pytest.approx(planes[1, 2])


def test_angles_that_are_all_but_round(read):
    luminaire = read(ies([0.0004, 89.9996], [0, 179.9996], [[100, 100]] * 2))
    assert luminaire.distribution.intensity(np.array([DOWN, FRONT, LEFT])) == pytest.approx(100)


def test_upward_light(read):
    luminaire = read(ies([90, 180], [0], [[0, 700]]))
    assert luminaire.distribution.intensity(np.array([DOWN, [0, 0, 1.0]])).tolist() == [0, 700]


def test_type_b_turns_about_a_horizontal_axis_in_the_luminaire(read):
    v, h = np.meshgrid([-90, 0, 90], [-90, -45, 0, 45, 90])
    luminaire = read(ies([-90, 0, 90], [-90, -45, 0, 45, 90], 1000 + v + 0.1 * h, kind=2))
    # Straight down, ahead, astern; then horizontal angle 90 and -90, clockwise: to the right of who looks ahead.
    found = luminaire.distribution.intensity(np.array([DOWN, FRONT, [-1, 0, 0], [0, -1 + 1e-9, -1e-6], [0, 1 - 1e-9, -1e-6]]))
    assert found == pytest.approx([1000, 1090, 910, 1009, 991], abs=1e-3)
    assert luminaire.distribution.intensity(np.array([[0.0, 0, 1]])).tolist() == [0]


def test_type_b_quadrant_is_mirrored_both_ways(read):
    luminaire = read(ies([0, 45, 90], [0, 60, 90], [[800, 400, 0], [300, 200, 0], [0, 0, 0]], kind=2))
    four = np.array([[x, y, -0.8] for x in (-0.5, 0.5) for y in (-0.3, 0.3)])
    assert np.ptp(luminaire.distribution.intensity(four)) < 1e-9
    assert luminaire.distribution.intensity(np.array([DOWN])) == pytest.approx(800)


def test_even_light_of_type_a_and_b_has_the_flux_of_its_solid_angle(read):
    for kind in (2, 3):
        assert read(ies([-90, 90], [-90, 90], np.full((2, 2), 10), kind=kind)).distribution.flux() == pytest.approx(20 * math.pi)
        assert read(ies([-90, 90], [0, 90], np.full((2, 2), 10), kind=kind)).distribution.flux() == pytest.approx(20 * math.pi)


def test_type_a_points_ahead_and_turns_clockwise(read):
    v, h = np.meshgrid([-90, 0, 90], [-90, 0, 90])
    luminaire = read(ies([-90, 0, 90], [-90, 0, 90], 1000 + v + 0.1 * h, kind=3))
    found = luminaire.distribution.intensity(np.array([FRONT, [1, 0, -1], [1, 0, 1], [0, -1, 0], LEFT, [-1.0, 0, 0]]))
    assert found == pytest.approx([1000, 955, 1045, 1009, 991, 0])


def test_opening_in_feet_and_round(read):
    luminaire = read(ies([0, 90], [0], [[1, 1]], unit=1, size=(-1, 2, 0.5)))
    assert luminaire.size == pytest.approx([0.6096, 0.3048, 0.1524])


def test_tilt(read):
    text = ies([0, 90], [0], [[100, 0]], tilt="INCLUDE\r\n2\r\n3\r\n0 45 90\r\n1 .9 .7")
    luminaire = read(text)
    assert luminaire.factor_when_tilted(67.5) == pytest.approx(0.8)
    assert luminaire.distribution.intensity(np.array([DOWN])) == pytest.approx(100)


def test_measured_light_of_a_file_on_a_grid(read):
    """A Lambert luminaire in steps of half a degree: E = I0 cos^4 / h2, as exactly as such steps can tell."""
    gamma = np.arange(0, 90.25, 0.5)
    luminaire = read(ies(gamma, [0], [1000 * np.cos(np.radians(gamma))]))
    x, y = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-3, 3, 13))
    floor = np.stack((x.ravel(), y.ravel(), np.zeros(x.size)), 1)
    lux = illuminance(luminaire.distribution, np.array([0, 0, 2.5]), np.eye(3), floor, np.tile([0, 0, 1.0], (len(floor), 1)))
    cosine = 2.5 / np.sqrt(x.ravel() ** 2 + y.ravel() ** 2 + 2.5**2)
    assert lux == pytest.approx(1000 * cosine**4 / 2.5**2, rel=2e-5)


# ---- EULUMDAT

C = np.arange(0, 360, 45)


def test_eulumdat_without_symmetry(read):
    table = np.random.default_rng(1).uniform(50, 300, (8, 4))
    luminaire = read(ldt(0, C, GAMMA, table, flux=3200, conversion=0.5), "lamp.LDT")
    assert [at(luminaire, c, 30) for c in C] == pytest.approx(table[:, 1] * 1.6)
    assert at(luminaire, 337.5, 60) == pytest.approx(0.8 * (table[0, 2] + table[7, 2]))
    assert luminaire.name == "made up"
    assert luminaire.watts == 36
    assert luminaire.size == pytest.approx([0.2, 1.2, 0])


@pytest.mark.parametrize(("symmetry", "given_planes"), [(1, [0]), (2, [0, 1, 2, 3, 4]), (3, [6, 7, 0, 1, 2]), (4, [0, 1, 2])])
def test_eulumdat_symmetry_is_written_out(read, symmetry, given_planes):
    def value(c, g):
        x, y = math.cos(math.radians(c)), math.sin(math.radians(c))
        odd = {1: 0, 2: x, 3: y, 4: 0}[symmetry]
        even = 0 if symmetry == 1 else x * x - y * y
        return 300 + (100 * odd + 50 * even) * g / 90

    partial = read(ldt(symmetry, C, GAMMA, [[value(C[i], g) for g in GAMMA] for i in given_planes]), "part.ldt").distribution
    whole = read(ldt(0, C, GAMMA, [[value(c, g) for g in GAMMA] for c in C]), "whole.ldt").distribution
    around = np.concatenate([towards(c, g) for c in np.arange(-5, 360, 11) for g in (0, 20, 60, 89)])
    assert partial.intensity(around) == pytest.approx(whole.intensity(around))
    assert partial.flux() == pytest.approx(whole.flux())


def test_eulumdat_absolute_photometry_and_several_sets_of_lamps(read):
    plain = ldt(1, C, GAMMA, [[100, 80, 40, 0]], flux=2000)
    for same in (
        ldt(1, C, GAMMA, [[100, 80, 40, 0]], flux=2000, lamps=-12),
        ldt(1, C, GAMMA, [[100, 80, 40, 0]], flux=2000, sets=3),
        plain.replace("0.5", "0,5"),
        plain.rstrip(),
    ):
        found = read(same, "a.ldt").distribution
        assert np.array_equal(found.candela, read(plain, "b.ldt").distribution.candela)
    assert found.intensity(np.array([DOWN])) == pytest.approx(200)


def test_code_page_of_the_time(read):
    text = ldt(1, [0], GAMMA, [[100, 80, 40, 0]]).replace("made up", "Bürostrahler…")
    assert read(text.encode("cp1252"), "a.ldt").name.startswith("Bürostrahler")
    assert read(b"\xef\xbb\xbf" + text.encode(), "a.ldt").name == "Bürostrahler…"


def test_the_same_light_in_both_formats(read):
    planes = np.random.default_rng(2).uniform(50, 300, (9, 4))
    planes[8] = planes[0]
    one, other = read(ies(GAMMA, [*C, 360], planes * 4)), read(ldt(0, C, GAMMA, planes[:8], flux=4000), "a.ldt")
    assert one.distribution.flux() == pytest.approx(other.distribution.flux())
    assert one.distribution.candela == pytest.approx(other.distribution.candela)


# ---- what can be wrong

GOOD_IES = ies([0, 45, 90], [0, 90], [[100, 60, 10], [100, 50, 5]], tilt="INCLUDE\r\n1\r\n2\r\n0 90\r\n1 .8")
GOOD_LDT = ldt(4, C, GAMMA, [[100, 80, 40, 0], [100, 70, 30, 0], [100, 60, 20, 0]])


def complaint(read, text, name):
    with pytest.raises(SceneError) as caught:
        read(text, name)
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("old", "new", "due"),
    [
        ("TILT=INCLUDE", "TLT=INCLUDE", "no line begins with TILT="),
        ("TILT=INCLUDE", "TILT=lamp.tlt", "line 3: TILT=lamp.tlt refers to another file, write TILT=NONE"),
        ("\r\n1\r\n2\r\n", "\r\n4\r\n2\r\n", "line 4: the lamp-to-luminaire geometry is 4"),
        ("0 90\r\n1 .8", "90 0\r\n1 .8", "line 6: the tilt angles do not rise"),
        ("1 .8", "1 -.8", "line 7: a tilt factor is negative"),
        ("1 1000 1 3 2 1 2", "1 1000 1 3 2 1 2.5", "line 8: the unit of length is 2.5"),
        ("1 1000 1 3 2 1 2", "1 1000 1 3 2 4 2", "line 8: the photometric type is 4 where only 1 (C), 2 (B), 3 (A)"),
        ("1 1000 1 3 2 1 2", "1 1000 0 3 2 1 2", "the product of multiplier and ballast factors is 0"),
        ("1 1000 1 3 2 1 2", "1 1000 1 1 2 1 2", "line 8: the number of vertical angles is 1"),
        ("1 1000 1 3 2 1 2", "1 1000 1 999999999999 2 1 2", "999999999999 vertical angles are announced"),
        ("1 1000 1 3 2 1 2", "1 1000 1 1e300 2 1 2", "more than the file can hold"),
        ("1 1000 1 3 2 1 2", "1 1000 1 3 3 1 2", "candela values are announced, more than the file can hold"),
        ("1 1000 1 3 2 1 2", "1 1000 1 3 1 1 2", "more numbers follow"),
        ("0 45 90\r\n", "0 45 45\r\n", "line 10: the vertical angles do not rise"),
        ("0 45 90\r\n", "0 45 190\r\n", "line 10: the vertical angles run from 0 to 190"),
        ("0 45 90\r\n", "20 45 90\r\n", "line 10: the vertical angles begin at 20 where Type C has 0 or 90"),
        ("0 90\r\n100", "0 91\r\n100", "line 11: the horizontal angles run from 0 to 91"),
        ("100 60 10", "100 -60 10", "an intensity is negative"),
        ("100 60 10", "100 1e13 10", "an intensity is above 1e+12 cd"),
        ("100 60 10", "100 nan 10", "line 12: 'nan' is no number"),
        ("100 60 10", "100 1e999 10", "line 12: '1e999' is no number"),
        ("100 60 10", "100 sixty 10", "line 12: 'sixty' is no number but stands among the candela values"),
        ("100 50 5", "100 50", "line 13: the file ends within the candela values"),
    ],
)
def test_wrong_ies(read, old, new, due):
    assert GOOD_IES.count(old) == 1
    assert due in complaint(read, GOOD_IES.replace(old, new), "lamp.ies")


def test_types_a_and_b_have_their_own_ranges(read):
    assert "Type B run from -80 to 90" in complaint(read, ies([-80, 90], [-90, 90], np.ones((2, 2)), kind=2), "b.ies")
    assert "Type A run from -90 to 45" in complaint(read, ies([-90, 90], [-90, 45], np.ones((2, 2)), kind=3), "a.ies")
    assert "Type A run from 0 to 0" in complaint(read, ies([-90, 90], [0], np.ones((1, 2)), kind=3), "a.ies")


@pytest.mark.parametrize(
    ("line", "text", "due"),
    [
        (3, "5", "line 3: the symmetry indicator is 5"),
        (4, "7", "line 4: 7 C-planes cannot have the symmetry 4"),
        (4, "4000000000", "line 4: the number of C-planes is 4000000000, more than the file has lines"),
        (4, "x", "line 4: 'x' is no number but stands for the number of C-planes"),
        (6, "1e300", "line 6: the number of intensities in a C-plane is 1e+300, more than the file has lines"),
        (6, "60", "line 66: the file ends here although its header announces 290 lines"),
        (6, "1", "line 6: the number of intensities in a C-plane is 1"),
        (24, "0", "line 24 or 29"),
        (26, "0", "line 26: the number of sets of lamps is 0"),
        (26, "50", "the file ends here"),
        (29, "inf", "line 29: 'inf' is no number"),
        (43, "10", "line 43: the angles of the C-planes do not fit the symmetry 4 of line 3"),
        (45, "20", "line 43: the angles of the C-planes do not rise"),
        (51, "10", "line 51: the angles gamma begin at 10"),
        (54, "181", "line 51: the angles gamma run from 0 to 181"),
        (56, "-3", "lines 55 to 66: an intensity is negative"),
        (56, "1e300", "an intensity is above"),
        (60, "", "line 60: '' is no number but stands for the intensities"),
    ],
)
def test_wrong_eulumdat(read, line, text, due):
    lines = GOOD_LDT.split("\r\n")
    lines[line - 1] = text
    assert due in complaint(read, "\n".join(lines), "lamp.ldt")


@pytest.mark.parametrize(("text", "name"), [(GOOD_IES, "lamp.ies"), (GOOD_LDT, "lamp.ldt")])
def test_no_file_that_lacks_lines_is_read(read, text, name):
    lines = text.rstrip().split("\r\n")
    for count in range(len(lines)):
        complaint(read, "\r\n".join(lines[:count]), name)


def test_files_that_are_no_photometry(tmp_path):
    with pytest.raises(SceneError, match=r"gone\.ies: there is no such file"):
        read_luminaire(tmp_path / "gone.ies")
    with pytest.raises(SceneError, match=r"\.ies or \.ldt"):
        read_luminaire(tmp_path / "lamp.xml")
    (tmp_path / "folder.ies").mkdir()
    with pytest.raises(SceneError, match=r"folder\.ies: the file cannot be read"):
        read_luminaire(tmp_path / "folder.ies")
    with (tmp_path / "big.ldt").open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(SceneError, match="more than 8 MB"):
        read_luminaire(str(tmp_path / "big.ldt"))
    with pytest.raises(SceneError):
        read_luminaire("nul\0byte.ies")


WORDS = ["", "-1", "0", "1e308", "-1e308", "nan", "inf", "1e999", "3.5", "999999999", "TILT=INCLUDE", "\r\n", " ", ",", "\0", "é"]


@pytest.mark.parametrize(("good", "suffix"), [(GOOD_IES, ".ies"), (GOOD_LDT, ".ldt")])
@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=st.lists(st.tuples(st.integers(0, 200), st.sampled_from(WORDS) | st.binary(max_size=4)), min_size=1, max_size=4))
@example(edits=[(9, "1e308")])
@example(edits=[(17, "1e308"), (18, "1e308")])
def test_whatever_is_done_to_a_file_it_is_read_or_refused_in_one_sentence(tmp_path, good, suffix, edits):
    words = good.encode().replace(b"\r\n", b" \r\n ").split(b" ")
    for where, word in edits:
        words[where % len(words)] = word.encode() if isinstance(word, str) else word
    check_read_or_refused(tmp_path / f"lamp{suffix}", b" ".join(words))


@pytest.mark.parametrize("suffix", [".ies", ".ldt"])
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200) | st.text(alphabet="0123456789.-+e, \nTILT=NONE", max_size=200).map(str.encode))
def test_any_bytes_are_read_or_refused_in_one_sentence(tmp_path, suffix, content):
    check_read_or_refused(tmp_path / f"lamp{suffix}", content)


def check_read_or_refused(path, content):
    path.write_bytes(content)
    try:
        luminaire = read_luminaire(path)
    except SceneError as error:
        message = str(error)
        assert message.startswith(str(path))
        assert "\n" not in message
        assert len(message) < len(str(path)) + 250
        return
    flux = luminaire.distribution.flux()
    assert math.isfinite(flux)
    assert flux >= 0
    assert np.all(np.isfinite(luminaire.distribution.intensity(np.concatenate((np.eye(3), -np.eye(3))))))
