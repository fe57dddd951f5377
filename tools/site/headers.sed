# Converts the headers' plain C comments for Doxygen: comments above a line and behind a line are distinguished by their position. The first one documents the file;
# section titles ("--- meshes --- */") document no line and stay plain.
1s|^/\* |/** @file\
 * |
/^\/\* --.*\*\/$/b
s|^/\* ---* *\([^-]*[^- ]\)[ -]*$|/** \u\1.|
s|^\( *\)/\* |\1/** |
s|^\( *[^ /*].*[;,{(] *\)/\* |\1/**< |
s|^\( *[A-Z][A-Z0-9_]* *\(= *[^ ]*\)\{0,1\} *\)/\* |\1/**< |
# Names in backticks.
s|`\([^`<>&]*\)`|<tt>\1</tt>|g
