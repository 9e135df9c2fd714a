# Writes ${OUT}: a C++ file with the text of every file in ${FILES}, as polypod::${NAMESPACE}::text_of_NAME, the name without its folder
# and with _ for what is no letter or digit. The text stands in pieces, since a literal may not be longer than 65536 bytes.
set(body "")
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} NAME)
  string(REGEX REPLACE "[^A-Za-z0-9]" "_" name ${name})
  file(READ ${file} text)
  string(LENGTH "${text}" length)
  set(pieces "")
  set(at 0)
  while(at LESS length)
    string(SUBSTRING "${text}" ${at} 8000 piece)
    string(APPEND pieces "\n    R\"text(${piece})text\"")
    math(EXPR at "${at} + 8000")
  endwhile()
  string(APPEND body "extern const std::string_view text_of_${name};\nconst std::string_view text_of_${name} =${pieces};\n")
endforeach()
file(WRITE ${OUT} "// Made at build time by cmake/EmbedText.cmake.
#include <string_view>

namespace polypod::${NAMESPACE} {
${body}}  // namespace polypod::${NAMESPACE}
")
