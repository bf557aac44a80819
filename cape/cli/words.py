"""What a command tells: in few words, things of one kind counted; all of it with --verbose."""

from collections.abc import Iterable

MOST = 500  # characters of a message
_END = 150  # characters of a long one's end that are kept: there it says what to do
_TOLD_OF_A_KIND = 2
_KINDS: tuple[str, ...] = (
    "the cloth enters ",
    "stuck in ",
    "the mesh ",
    "the joint ",
    "quaternions of ",
    ": its collision geometry takes up ",
)
"""What sentences have in common that differ in a name and figures alone."""


class Verbosity:
    """Whether everything is told, as the command line asks."""

    everything = False


def be_verbose(asked: bool) -> None:
    """Take what the option --verbose says, before a command begins."""
    Verbosity.everything = asked


def shortened(text: str) -> str:
    """A message, its middle left out where it is long."""
    if Verbosity.everything or len(text) <= MOST:
        return text
    mark = " ... "
    told = " (all of it: --verbose)"
    kept = MOST - _END - len(mark) - len(told)
    begin, end = text[:kept].rsplit(" ", 1)[0], text[-_END:].split(" ", 1)[-1]
    return begin + mark + end + told


def gathered(sentences: Iterable[str]) -> list[str]:
    """Sentences in their order, short; of each kind the first ones, and how many more there are."""
    sentences = list(sentences)
    if Verbosity.everything:
        return sentences
    told: list[str] = []
    count = dict.fromkeys(_KINDS, 0)
    for sentence in sentences:
        kind = next((kind for kind in _KINDS if kind in sentence), None)
        if kind is not None:
            count[kind] += 1
            if count[kind] > _TOLD_OF_A_KIND:
                continue
        told.append(shortened(sentence))
    for kind, number in count.items():
        if number > _TOLD_OF_A_KIND:
            place = max(k for k, sentence in enumerate(told) if kind in sentence)
            told[place] += f" (and {number - _TOLD_OF_A_KIND} more like it: --verbose)"
    return told
