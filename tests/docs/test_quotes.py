"""Quotations: messages that the troubleshooting pages quote are printed by a program, and sentences that readers could not understand do not come back."""
import re
import subprocess

import pytest

CODE = (".c", ".h", ".cpp", ".py", ".sh", ".lcm")


def tracked(root, keep):
    for name in subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=True).stdout.splitlines():
        if keep(name) and (root / name).is_file():
            yield name, (root / name).read_text(encoding="utf-8", errors="replace")


@pytest.fixture(scope="module")
def printed(root):
    """Sources of programs and libraries, with the pieces of split string literals joined."""
    text = "\n".join(text for _, text in tracked(root, lambda n: n.endswith(CODE) and not n.startswith("tests/")))
    return re.sub(r'"\s*(?:PRI\w+\s*)?f?"', "", text).replace('\\"', '"')


def pieces(quote):
    """The constant parts of a quoted message: numbers, file names, addresses and "…" stand for what differs."""
    quote = re.sub(r"\d[\d.e+-]*|'[^']*'|udpm://\S*|virtual:\S*|\b[A-Z_]{4,}\b|\b(?:TM-SIM|tm-sim|haptic-rt)\b|\w+_\d\b|(?:No space left on device)", "\0", quote)
    quote = re.sub(r"^N |\b(?:controller|bus_off|bus_conflict)\b", "\0", quote)
    return [p.strip(" :;,.()") for p in re.split("[\0…;]", quote) if len(p.strip(" :;,.()")) > 5]


def quotes(text):
    for line in text.split("\n"):
        if "**See**" in line:
            for part in line.split("**See**")[1:]:
                yield from (q for q in re.findall(r"`([^`]+)`", re.split(r"\*\*(?:Why|Do)\*\*", part)[0]) if " " in q and not q.startswith(("make ", "tm-")))


@pytest.mark.parametrize("name", ["troubleshooting", "troubleshooting-network"])
def test_messages_that_a_page_quotes_are_printed(root, printed, name):
    found = list(quotes((root / f"docs/{name}.md").read_text()))
    assert len(found) >= 7, found
    stale = [f"{q!r}: {p!r}" for q in found for p in pieces(q) if p not in printed]
    assert not stale, f"docs/{name}.md quotes what no program prints:\n" + "\n".join(stale)


def test_a_stale_quotation_would_be_seen(printed):
    assert list(quotes("- **See** `another session speaks`. **Why** `x y`.")) == ["another session speaks"]
    assert any(p not in printed for p in pieces("another session" + " speaks"))


# What testers quoted as impossible to understand: a fragment of each sentence, at least four words long.
RIDDLES = (
    "what they touch: rows are found at the shape that the forces of before would make", "light tissue swings from that by more than its skin is deep",
    "a solution in full leaves it as it is", "contact knows what is around a tool without it", "so asking changes no bit",
    "rows of one station take over from one another", "a row that waits starts from the depth", "what has not come true of a force that sticks",
    "stays in its stretch, so that nothing is lost", "no shares do better that must hold after every cut", "is exactly irons' figure for it",
    "what relaxes out of line with its strain", "weights begin in proportion to the gradients and follow the loads five times",
    "the 0.85 was the team's", "was half a millisecond late", "two runs before, of the same loop", "at a border rows are rows as any",
    "spans then let in beforehand how the force drifts", "with both ends of spans as above", "a stiffness on the lip was that of another rest",
    "the figure hangs on a hair", "with memories of two and of three rounds", "to other tissue the force goes at that pace",
    "a new patch takes over the reactions, and what the rounds remember", "where the path's end (a lobe held high) went over into its beginning",
    "% of a processor promised and", "from `/` on", "a line that nobody writes need not come from another core", "rotation takes what the linear tensors give away again",
    "what has died away to nothing becomes nothing", "what is chosen is then placed exactly", "what the tools look at",
    "trouble alone is said, not that all is well", "nobody moves instrument", "what was tried to make the step cheap", "a part is worth a thread from",
    "so that what is averaged knows of no turn", "what all its rows bore then", "it cannot be followed, and but for scratch",
)
STYLE = ("docs/style.md", "tests/docs/test_quotes.py", "CHANGELOG.md")


def plain(text):
    """Lower case, comment marks and line breaks as one blank."""
    return re.sub(r"\s+", " ", re.sub(r"(?m)^\s*(?:\*|//|#)+ ?", " ", text)).lower()


def test_no_sentence_that_testers_could_not_understand_is_left(root):
    left = []
    for name, text in tracked(root, lambda n: n.endswith((*CODE, ".md", ".yaml", ".mk")) and n not in STYLE and not n.startswith(("notes/", "tests/fuzz/corpus/"))):
        text = plain(text)
        left += [f"{name}: {riddle}" for riddle in RIDDLES if riddle in text]
    assert len(RIDDLES) > 35 and not left, "\n".join(left)


def test_a_riddle_would_be_seen():
    assert "what the tools look at" in plain("/* What the\n * tools look at */")


def test_versions_that_pages_name_are_the_present_one(root):
    version = re.search(r"^VERSION := (\d+\.\d+)", (root / "Makefile").read_text(), re.M)[1]
    text = "".join(page.read_text() for page in (root / "docs").rglob("*.md"))
    named = re.findall(r"find_package\(tensormass (\d+\.\d+)|`libtensormass[a-z-]*(\d+\.\d+)`", text)
    assert len(named) > 3 and {a or b for a, b in named} == {version}, named
