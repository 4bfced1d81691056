// What Apache PDFBox Preflight finds in a PDF file, one line for each error: its code, then its words. Preflight knows PDF/A-1b.

import java.io.File;
import org.apache.pdfbox.preflight.PreflightDocument;
import org.apache.pdfbox.preflight.ValidationResult;
import org.apache.pdfbox.preflight.exception.SyntaxValidationException;
import org.apache.pdfbox.preflight.parser.PreflightParser;

public class Preflight {
    public static void main(String[] files) throws Exception {
        PreflightParser parser = new PreflightParser(new File(files[0]));
        ValidationResult found;
        try {
            parser.parse();
            try (PreflightDocument document = parser.getPreflightDocument()) {
                document.validate();
                found = document.getResult();
            }
        } catch (SyntaxValidationException error) {
            found = error.getResult();
        }
        for (ValidationResult.ValidationError error : found.getErrorsList()) {
            System.out.println(error.getErrorCode() + " " + error.getDetails());
        }
    }
}
