# Adapts a page to a prefix: awk -v have="NAME NAME ..." -f install_pages.awk PAGE. Links to installed pages
# stay (README's without their folder); others become plain text, because a source tree's paths are invalid there.
BEGIN {
    count = split(have, name, " ")
    for (i = 1; i <= count; i++) installed[name[i]] = 1
    place["tests/install/block.c"] = "examples/block.c"
    place["examples/engine"] = "examples/engine.c"
}
/^```/ { code = !code }
{
    line = code ? "" : $0
    out = ""
    while (match(line, /!?\[[^][]*\]\([^()[:space:]]*\)/)) {
        link = substr(line, RSTART, RLENGTH)
        out = out substr(line, 1, RSTART - 1)
        line = substr(line, RSTART + RLENGTH)
        words = link
        sub(/^!?\[/, "", words)
        sub(/\]\([^()]*\)$/, "", words)
        target = link
        sub(/^.*\]\(/, "", target)
        sub(/\)$/, "", target)
        at = target
        sub(/#.*$/, "", at)
        part = substr(target, length(at) + 1)
        sub(/^docs\//, "", at)
        if (at in place) at = place[at]
        if (at ~ /:\/\// || at == "" || at in installed)
            out = out (link ~ /^!/ ? "!" : "") "[" words "](" at part ")"
        else
            out = out words
    }
    print code ? $0 : out line
}
