# The headers' comments are plain C; to Doxygen a comment above a line and one behind it are told from their places. The first is the file's;
# titles of sections ("--- meshes --- */") belong to no line and stay plain.
1s|^/\* |/** @file\
 * |
/^\/\* --.*\*\/$/b
s|^/\* ---* *\([^-]*[^- ]\)[ -]*$|/** \u\1.|
s|^\( *\)/\* |\1/** |
s|^\( *[^ /*].*[;,{(] *\)/\* |\1/**< |
s|^\( *[A-Z][A-Z0-9_]* *\(= *[^ ]*\)\{0,1\} *\)/\* |\1/**< |
# Names in backticks.
s|`\([^`<>&]*\)`|<tt>\1</tt>|g
