#pragma once

#include <filesystem>
#include <string>

namespace cleave::app {

struct NewPluginOptions {
  std::string kind;                 ///< "elasticity"
  std::string name;                 ///< "my-law", of the ID "elasticity/my-law"
  std::filesystem::path directory;  ///< empty: ./NAME
};

/// `cleave new-plugin`: writes a project that builds, tests and runs a plugin of this kind with the installed SDK. Returns the
/// exit status. Throws InputError; nothing is written then.
///
/// The templates lie in share/cleave/templates beside the program's bin directory: a folder for each kind, and `common` for
/// all. In their texts and file names
///
///   {{id}}   my-law        {{Type}} MyLaw
///   {{file}} my_law        {{kind}} elasticity
///
/// stand for what they say. Of a file that is in both folders, the kind's text takes the place of {{of this kind}} in the
/// common one.
int new_plugin_command(const NewPluginOptions&);

}  // namespace cleave::app
