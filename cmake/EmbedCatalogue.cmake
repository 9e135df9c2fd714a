# Writes ${OUT}: a C++ file with the text of every machine file in ${FILES}.
set(body "")
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} NAME_WE)
  file(READ ${file} text)
  string(APPEND body "    {\"${name}\", R\"toml(${text})toml\"},\n")
endforeach()
file(WRITE ${OUT} "// Made from machines/*.toml at build time.
#include \"polypod/machine/any_machine.hpp\"

namespace polypod::machine {
const std::vector<CatalogueEntry>& catalogue() {
  static const std::vector<CatalogueEntry> entries{
${body}  };
  return entries;
}
}  // namespace polypod::machine
")
