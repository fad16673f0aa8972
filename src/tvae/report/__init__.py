"""What was found, as one web page that needs nothing but itself: `page.render` of a `ReportContent`."""
