# Writes ${OUT}: a C++ file with what viewer/dist holds in ${FOLDER}.
include(${FOLDER}/hashes.cmake)
foreach(part page.js live.js viewer.b64 licences.txt)
  file(READ ${FOLDER}/${part} text)
  string(REGEX REPLACE "\n$" "" text "${text}")
  string(MAKE_C_IDENTIFIER ${part} name)
  string(APPEND body "const std::string_view ${name} = R\"viewer(${text})viewer\";\n")
endforeach()
file(WRITE ${OUT} "// Made from viewer/dist at build time.
#include \"viewer_bundle.hpp\"

namespace polypod::report::viewer {
${body}const std::string_view live_sha256 = \"${live_sha256}\";
const std::string_view page_sha256 = \"${page_sha256}\";
const std::string_view viewer_sha256 = \"${viewer_sha256}\";
}  // namespace polypod::report::viewer
")
