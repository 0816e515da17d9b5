#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <boost/property_tree/json_parser.hpp>
#include <boost/property_tree/ptree.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

/// Runs the program as a person would, in a directory of its own.
namespace cleave::test {

namespace fs = std::filesystem;

struct Outcome {
  int status = -1;
  std::string out, err;
};

class Program : public testing::Test {
 protected:
  Program() {
    std::string name = (fs::temp_directory_path() / "cleave-run-XXXXXX").string();
    directory = mkdtemp(name.data());
  }
  ~Program() override { fs::remove_all(directory); }

  static std::string contents(const fs::path& file) {
    std::ifstream in(file);
    std::stringstream s;
    s << in.rdbuf();
    return s.str();
  }

  Outcome cleave(const std::string& arguments, const std::string& before = "") const {
    const std::string command = "cd '" + directory.string() + "' && " + before + " '" CLEAVE_PROGRAM "' " + arguments +
                                " >stdout.txt 2>stderr.txt </dev/null";
    const int status = std::system(command.c_str());
    Outcome o;
    o.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    o.out = contents(directory / "stdout.txt");
    o.err = contents(directory / "stderr.txt");
    return o;
  }

  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(directory / name) << text;
    return directory / name;
  }

  static boost::property_tree::ptree json(const fs::path& file) {
    boost::property_tree::ptree tree;
    boost::property_tree::read_json(file.string(), tree);
    return tree;
  }

  /// Columns of a CSV file by name; text stays text.
  static std::map<std::string, std::vector<std::string>> table(const fs::path& file) {
    std::ifstream in(file);
    std::vector<std::string> header;
    std::map<std::string, std::vector<std::string>> columns;
    for (std::string line; std::getline(in, line);) {
      std::stringstream s(line);
      std::vector<std::string> cells;
      for (std::string cell; std::getline(s, cell, ',');) cells.push_back(cell);
      if (header.empty())
        header = cells;
      else
        for (std::size_t i = 0; i < header.size(); i++) columns[header[i]].push_back(i < cells.size() ? cells[i] : "");
    }
    return columns;
  }
  static std::vector<double> numbers(const std::vector<std::string>& cells) {
    std::vector<double> n;
    for (const auto& c : cells) n.push_back(std::strtod(c.c_str(), nullptr));
    return n;
  }

  fs::path directory;
};

}  // namespace cleave::test
