"""Reads the `--help` of our programs: options with arguments and descriptions, paragraphs and headings. Man pages and completion are made from it, so that
each help is written once. (help2man supports only one option a line and GNU's headings.)"""
import re
from dataclasses import dataclass, field
from typing import List, Optional, Union

OPTION = re.compile(r"(--?[A-Za-z][\w-]*)(?:[ =](?!--?[A-Za-z])([^\s,|]\S*))?")


@dataclass
class Option:
    """`names` as typed: one option and its short form, or several options with one description."""
    names: List[str]
    label: str  # as in the help: "-h, --help"
    argument: Optional[str]
    text: str


@dataclass
class Help:
    usage: List[str] = field(default_factory=list)
    body: List[Union[str, Option]] = field(default_factory=list)  # "# heading", a paragraph, or an option
    commands: List[str] = field(default_factory=list)  # of tm-mesh

    @property
    def options(self) -> List[Option]:
        return [b for b in self.body if isinstance(b, Option)]

    text: str = ""

    @property
    def words(self) -> List[str]:
        """Returns every long option in the help, also those within sentences."""
        own = re.sub(r"(?:tm-[a-z]+|haptic-rt) --[a-z-]+", "", self.text) if self.options else ""
        return list(dict.fromkeys(re.findall(r"(?<![\w-])--[a-z][\w-]*", own)))


def option_of(cells):
    found = OPTION.findall(cells[0])
    names = [name for name, _ in found]
    arguments = [argument for _, argument in found if argument]
    return Option(names, cells[0], arguments[0] if arguments else None, " ".join(cells[1:]))


def cells_of(line):
    """Splits a line into [[label, words...], ...]; a line may contain two options side by side."""
    rows = []
    for cell in re.split(r" {2,}", line.strip()):
        if re.match(r"--?[A-Za-z]", cell):
            rows.append([cell])
        elif rows:
            rows[-1].append(cell)
        else:
            return []
    return rows


def words_of(line):
    return " ".join(line.split())


def read(text):
    """Parses a program's `--help`."""
    told = Help(text=text)
    lines = text.rstrip().split("\n")
    usage = re.match(r"(?:usage: *)?(.*)", lines[0]).group(1)
    first, colon, rest = usage.partition(": ")
    told.usage.append(first)
    paragraph = [rest] if colon and rest else []

    def end():
        if paragraph:
            told.body.append(" ".join(paragraph))
            paragraph.clear()

    blank = False
    for line in lines[1:]:
        said, after_blank = line.strip(), blank
        blank = not said
        rows = cells_of(line) if line.startswith("  ") else []
        command = re.match(r"  ([a-z]+) {2,}(\S.*)", line) if "COMMAND" in told.usage[0] else None
        if not said:
            end()
        elif not told.body and not paragraph and line.startswith("       "):
            if said.startswith("tm-") or said.startswith("haptic-rt"):
                told.usage.append(words_of(re.split(r" {3,}", said)[0]))
            else:
                told.usage[-1] += " " + words_of(said)
        elif command:
            end()
            told.commands.append(command.group(1))
            told.body.append(Option([command.group(1)], command.group(1), None, command.group(2)))
        elif rows:
            end()
            told.body += [option_of(cells) for cells in rows]
        elif line.startswith("  ") and told.body and isinstance(told.body[-1], Option) and not paragraph and not after_blank:
            told.body[-1].text = (told.body[-1].text + " " + words_of(said)).strip()
        elif re.fullmatch(r"[A-Za-z ]+:?", said) and len(said) < 24 and not line.startswith(" "):
            end()
            told.body.append("# " + said.rstrip(":"))
        else:
            paragraph.append(words_of(said))
    end()
    return told
