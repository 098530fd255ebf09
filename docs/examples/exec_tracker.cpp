// A tracker as a program: g++ -O2 -std=c++17 docs/examples/exec_tracker.cpp -o my_tracker; run --tracker exec:./my_tracker
// Nearest neighbour within 3 m, fixed gains. It reads scans from stdin and writes tracks to stdout.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

struct Track { int id; double lon, lat, lon_speed, lat_speed, seen_s; int hits; };
static std::string word() { std::string text; std::cin >> text; return text; }
static double number() { return std::strtod(word().c_str(), nullptr); }  // reads nan and inf, as >> does not
static void rest_of_line() { std::cin.ignore(1 << 30, '\n'); }

int main() {
    double gain = 0.5, last_s = NAN;
    for (std::string line, name; std::getline(std::cin, line) && line != "end";)
        if (line.rfind("option gain ", 0) == 0) gain = std::stod(line.substr(12));
    std::cout << "ready" << std::endl;

    std::vector<Track> tracks;
    int next_id = 1;
    while (word() == "scan") {
        const int scan = static_cast<int>(number());
        const double time_s = number();
        const int count = static_cast<int>(number());
        std::vector<std::vector<double>> found(count, std::vector<double>(14));
        word(), number(), number();  // the ego's place is not used here, and neither is its size
        const double turn = number(), v = number();
        rest_of_line();
        for (auto& row : found) { for (double& value : row) value = number(); rest_of_line(); }
        rest_of_line(), rest_of_line();  // the free space and the signals
        const double step_s = std::isnan(last_s) ? 0.1 : time_s - last_s;
        last_s = time_s;

        std::vector<Track> kept;
        for (Track& track : tracks) {
            track.lon += track.lon_speed * step_s, track.lat += track.lat_speed * step_s;
            size_t nearest = 0;
            auto away = [&](size_t k) { return std::hypot(found[k][0] - track.lon, found[k][1] - track.lat); };
            for (size_t k = 1; k < found.size(); ++k) if (away(k) < away(nearest)) nearest = k;
            if (!found.empty() && away(nearest) < 3.0) {
                const double off_lon = found[nearest][0] - track.lon, off_lat = found[nearest][1] - track.lat;
                track.lon += gain * off_lon, track.lat += gain * off_lat;
                track.lon_speed += 0.3 * gain * off_lon / step_s, track.lat_speed += 0.3 * gain * off_lat / step_s;
                track.hits += 1, track.seen_s = time_s;
                found.erase(found.begin() + nearest);
            }
            if (time_s - track.seen_s < 1.5) kept.push_back(track);
        }
        for (auto& row : found)
            kept.push_back({next_id++, row[0], row[1], v * std::cos(turn), v * std::sin(turn), time_s, 1});
        tracks = kept;
        std::printf("tracks %d %zu\n", scan, tracks.size());
        for (const Track& t : tracks)
            std::printf("%d %.17g %.17g %.17g 0 0 0.3 0.2 1 1 %s\n", t.id, t.lon, t.lat,
                        std::hypot(t.lon_speed, t.lat_speed), t.hits >= 3 ? "confirmed" : "tentative");
        std::fflush(stdout);
    }
}
