#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::plugins {

/// Puts a directory before all others that plugins are looked for in, for this program and those that it starts.
/// Throws InputError if it is none.
void allow_plugins_from(const std::filesystem::path& directory);

/// From now on, in this program and those that it starts, a library is opened in a child process first; see problem_in_child().
void isolate_plugins();
bool plugins_are_isolated();

/// Why a file of a plugin directory is not to be opened, as a refusal: it is no regular file, or it is a link that leads out of
/// all of the directories. Empty if it may be.
std::optional<std::string> problem_with_place(const std::filesystem::path& file,
                                              const std::vector<std::filesystem::path>& directories);

/// Those of a file, its directory and the directories above that any user can change, so that any user's code can run as this
/// one's: files and directories that all may write to. A directory with the sticky bit above that of the file is none: there
/// only owners rename.
std::vector<std::filesystem::path> world_writable(const std::filesystem::path& file);

/// Of the contents of a file, in hexadecimal digits. Throws InputError if it cannot be read.
std::string sha256_of_file(const std::filesystem::path&);

/// Opens and closes a library in a child process, which may take so many seconds. What happened there, as a refusal: that of
/// the library, or that it crashed, ended the process or hung. Empty if the library is sound.
std::optional<std::string> problem_in_child(const std::filesystem::path& library, double seconds = 10);

}  // namespace cleave::plugins
